static int told(Instance *of, int status, String message)
{
    void (*log)(void *, int, String, String) = (void (*)(void *, int, String, String))of->log;
    if (status != OK && log) log(of->environment, status, "logStatusError", message);
    return status;
}

API String fmi3GetVersion(void) { return "3.0"; }
API void *fmi3InstantiateModelExchange(String name, String token, String resources, bool visible, bool logging,
                                       void *environment, void *log)
{ return begin(name, token, environment, log); }
API void *fmi3InstantiateCoSimulation(String name, String token, String resources, bool visible, bool logging,
                                     bool events, bool early, const Reference *needed, size_t n, void *environment,
                                     void *log, void *update)
{ return begin(name, token, environment, log); }
API void *fmi3InstantiateScheduledExecution(void) { return NULL; }
API int fmi3EnterInitializationMode(Instance *of, bool to, double tolerance, double t, bool ends, double end)
{ of->now.t = t; return OK; }

API int fmi3GetFloat64(Instance *of, const Reference *r, size_t n, double *values, size_t nv)
{ return told(of, n == nv ? get(&of->now, r, n, values) : ERROR, UNKNOWN); }
API int fmi3SetFloat64(Instance *of, const Reference *r, size_t n, const double *values, size_t nv)
{ return told(of, n == nv ? set(&of->now, r, n, values) : ERROR, NOT_SET); }
API int fmi3GetDirectionalDerivative(Instance *of, const Reference *unknowns, size_t rows, const Reference *knowns,
                                     size_t columns, const double *seed, size_t ns, double *found, size_t nf)
{ return told(of, directional(&of->now, unknowns, rows, knowns, columns, seed, found), UNKNOWN); }
API int fmi3DoStep(Instance *of, double t, double length, bool whole, bool *event, bool *end, bool *early, double *last)
{
    const int status = told(of, advance(&of->now, t, length), NOT_FINITE);
    *event = *end = *early = false;
    *last = of->now.t;
    return status;
}

API int fmi3GetNumberOfEventIndicators(Instance *of, size_t *n) { *n = 0; return OK; }
API int fmi3GetNumberOfContinuousStates(Instance *of, size_t *n) { *n = NX; return OK; }
API int fmi3UpdateDiscreteStates(Instance *of, bool *again, bool *end, bool *scale, bool *value, bool *timed, double *t)
{ *again = *end = *scale = *value = *timed = false; return OK; }

SAME(EnterConfigurationMode) SAME(ExitConfigurationMode) SAME(EnterStepMode) SAME(EvaluateDiscreteStates)
NONE_OF(Float32) NONE_OF(Int8) NONE_OF(UInt8) NONE_OF(Int16) NONE_OF(UInt16) NONE_OF(Int32) NONE_OF(UInt32)
NONE_OF(Int64) NONE_OF(UInt64) NONE_OF(Binary) NONE_OF(Clock) NONE_OF(IntervalDecimal) NONE_OF(IntervalFraction)
NONE_OF(ShiftDecimal) NONE_OF(ShiftFraction) NONE(GetNumberOfVariableDependencies) NONE(GetVariableDependencies)
NONE(GetAdjointDerivative) NONE(GetOutputDerivatives) NONE(ActivateModelPartition)
