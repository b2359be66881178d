/* Co-Simulation FMU 2.0 of a hydraulic cylinder that turns a joint. The ends of the cylinder, A on the moving link and B
   on the fixed one, are given in the plane of the motion; a pump moves oil for the length from L0 to L1 in T seconds.
   Numbers come from the command line of the compiler. */
#include <math.h>
#include <stdlib.h>

enum { Q, QD, TORQUE, BORE, ROD, COUNT };
typedef struct { double t, value[COUNT]; } Cylinder;
typedef const unsigned int *References;

static double pressure(double area, double volume, double first, double l, double d)
{
    const double full = first + BULK * log((volume + area * l) / (volume + area * d));
    return fmax(full, -101325.0); /* 0 absolute: the chamber is empty */
}

static void evaluate(Cylinder *of)
{
    const double *in = of->value, c = cos(in[Q]), s = sin(in[Q]), part = fmin(of->t / T, 1.0), away = 1.0 - part;
    const double l = L0 + (L1 - L0) * part * part * part * (10.0 - 15.0 * part + 6.0 * part * part);
    const double rate = (L1 - L0) * 30.0 * part * part * away * away / T; /* of the length, from rest to rest */
    const double x = c * AX - s * AY - BX, y = s * AX + c * AY - BY, d = hypot(x, y);
    const double lever = (x * (-s * AX - c * AY) + y * (c * AX - s * AY)) / d; /* length per angle */
    const double bore = pressure(AREA_BORE, VOLUME_BORE, FIRST_BORE, l, d);
    const double rod = pressure(AREA_ROD, VOLUME_ROD, FIRST_ROD, l, d);
    const double push = AREA_BORE * bore + AREA_ROD * rod - DAMPING * (lever * in[QD] - rate);
    of->value[TORQUE] = lever * push, of->value[BORE] = bore, of->value[ROD] = rod;
}

const char *fmi2GetVersion(void) { return "2.0"; }
const char *fmi2GetTypesPlatform(void) { return "default"; }
void *fmi2Instantiate(void) { return calloc(1, sizeof(Cylinder)); }
void fmi2FreeInstance(Cylinder *of) { free(of); }
int fmi2SetupExperiment(Cylinder *of, int to, double tolerance, double t) { of->t = t; return 0; }
int fmi2EnterInitializationMode(Cylinder *of) { return 0; }
int fmi2ExitInitializationMode(Cylinder *of) { return 0; }
int fmi2Terminate(Cylinder *of) { return 0; }
int fmi2SetDebugLogging(Cylinder *of) { return 0; }
int fmi2Reset(Cylinder *of) { *of = (Cylinder){0}; return 0; }
int fmi2DoStep(Cylinder *of, double t, double length, int whole) { of->t = t + length; return 0; }
int fmi2SetReal(Cylinder *of, References to, size_t count, const double *values)
{
    for (size_t k = 0; k < count; k++) of->value[to[k]] = values[k];
    return 0;
}
int fmi2GetReal(Cylinder *of, References from, size_t count, double *values)
{
    evaluate(of);
    for (size_t k = 0; k < count; k++) values[k] = of->value[from[k]];
    return 0;
}

/* Other types, states that are stored, and derivatives: errors. */
#define NONE(name) int fmi2##name(void) { return 3; }
NONE(GetInteger) NONE(SetInteger) NONE(GetBoolean) NONE(SetBoolean) NONE(GetString) NONE(SetString)
NONE(GetFMUstate) NONE(SetFMUstate) NONE(FreeFMUstate) NONE(SerializedFMUstateSize) NONE(SerializeFMUstate)
NONE(DeSerializeFMUstate) NONE(GetDirectionalDerivative) NONE(SetRealInputDerivatives) NONE(GetRealOutputDerivatives)
NONE(CancelStep) NONE(GetStatus) NONE(GetRealStatus) NONE(GetIntegerStatus) NONE(GetBooleanStatus) NONE(GetStringStatus)
