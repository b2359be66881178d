typedef void (*Logger)(void *, String, int, String, String, ...);
typedef struct { Logger log; void *allocate, *release, *finished, *environment; } Callbacks;
typedef struct { int again, end, nominals, values, timed; double t; } Events;

static int told(Instance *of, int status, String message)
{
    if (status != OK && of->log) ((Logger)of->log)(of->environment, of->name, status, "logStatusError", message);
    return status;
}

API String fmi2GetVersion(void) { return "2.0"; }
API String fmi2GetTypesPlatform(void) { return "default"; }
API void *fmi2Instantiate(String name, int kind, String token, String resources, const Callbacks *calls, int visible,
                          int logging)
{ return begin(name, token, calls->environment, (void *)calls->log); }
API int fmi2SetupExperiment(Instance *of, int to, double tolerance, double t, int ends, double end)
{ of->now.t = t; return OK; }

API int fmi2GetReal(Instance *of, const Reference *r, size_t n, double *values)
{ return told(of, get(&of->now, r, n, values), UNKNOWN); }
API int fmi2SetReal(Instance *of, const Reference *r, size_t n, const double *values)
{ return told(of, set(&of->now, r, n, values), NOT_SET); }
API int fmi2GetDirectionalDerivative(Instance *of, const Reference *unknowns, size_t rows, const Reference *knowns,
                                     size_t columns, const double *seed, double *found)
{ return told(of, directional(&of->now, unknowns, rows, knowns, columns, seed, found), UNKNOWN); }
API int fmi2DoStep(Instance *of, double t, double length, int whole)
{ return told(of, advance(&of->now, t, length), NOT_FINITE); }
API int fmi2NewDiscreteStates(Instance *of, Events *events) { *events = (Events){0}; return OK; }

SAME(EnterInitializationMode) NONE_OF(Integer) NONE(SetRealInputDerivatives) NONE(GetRealOutputDerivatives)
NONE(CancelStep) NONE(GetStatus) NONE(GetRealStatus) NONE(GetIntegerStatus) NONE(GetBooleanStatus) NONE(GetStringStatus)
