/* What FMI 2.0 and 3.0 have in common. fmiN stands for fmi2 or fmi3, Flag for their type of truth values. */
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif
#define UNKNOWN "a value reference is unknown, or not of this kind"
#define NOT_SET "a value is not finite, or belongs to a variable that cannot be set"
#define NOT_FINITE "the state is not finite after the step; the parameter `step` may be too long for these inputs"

enum { OK, WARNING, DISCARD, ERROR, FATAL };
enum { NX = NAME_STATES, NV = NX / 2, NU = NAME_INPUTS, NY = NAME_OUTPUTS, NW = NX + NU };
enum { TIME, U, X = U + NU, DX = X + NX, Y = DX + NX, STEP = Y + NY };
typedef unsigned int Reference;
typedef const char *String;
typedef struct { double t, step, x[NX], u[NU]; } State;
typedef struct { State now; void *environment, *log; char name[128]; } Instance;

static const State start = {START};
static int told(Instance *of, int status, String message); /* the status, which is logged unless it is OK */

static Instance *begin(String name, String token, void *environment, void *log)
{
    Instance *made = strcmp(token, "TOKEN") ? NULL : calloc(1, sizeof *made);
    if (made) made->now = start, made->environment = environment, made->log = log, strncpy(made->name, name, 127);
    return made;
}

static int get(const State *now, const Reference *from, size_t count, double *values)
{
    double dx[NX], y[NY];
    int rated = 0, seen = 0;
    for (size_t k = 0; k < count; k++) {
        const Reference r = from[k];
        if (r >= DX && r < Y && !rated++) NAME_rate(now->x, now->u, dx);
        if (r >= Y && r < STEP && !seen++) NAME_outputs(now->x, now->u, y);
        if (r > STEP) return ERROR;
        values[k] = r == TIME ? now->t : r < X ? now->u[r - U] : r < DX ? now->x[r - X]
                  : r < Y ? dx[r - DX] : r < STEP ? y[r - Y] : now->step;
    }
    return OK;
}

static int set(State *now, const Reference *to, size_t count, const double *values)
{
    for (size_t k = 0; k < count; k++) {
        const Reference r = to[k];
        if (!isfinite(values[k]) || r == TIME || (r >= DX && (r != STEP || values[k] <= 0.0))) return ERROR;
        *(r < X ? &now->u[r - U] : r < DX ? &now->x[r - X] : &now->step) = values[k];
    }
    return OK;
}

/* A communication step: equal steps of at most `step` seconds. */
static int advance(State *now, double t, double length)
{
    const double count = fmax(1.0, ceil(length / now->step - 1e-9));
    if (!(length > 0.0)) return ERROR;
    for (double k = 0.0; k < count; k += 1.0) NAME_step(now->x, now->u, length / count);
    now->t = t + length;
    for (int i = 0; i < NX; i++)
        if (!isfinite(now->x[i])) return ERROR;
    return OK;
}

/* Derivatives of unknowns in the direction `seed` of the knowns: M dv' = N (dx, du), dy = S (dx, du, dv'). */
static int directional(const State *now, const Reference *unknowns, size_t rows, const Reference *knowns,
                       size_t columns, const double *seed, double *found)
{
    double M[NV * NV], N[NV * NW], S[NY * (NW + NV)], along[NW] = {0.0}, rate[NX] = {0.0}, y[NY] = {0.0};
    for (size_t k = 0; k < columns; k++) {
        const Reference r = knowns[k];
        if (r == TIME || r >= DX) return ERROR;
        along[r < X ? NX + r - U : r - X] += seed[k];
    }
    NAME_implicit(now->x, now->u, M, N);
    NAME_output_slopes(now->x, now->u, S);
    memcpy(rate, along + NV, sizeof(double) * NV);
    for (int j = 0; j < NW; j++) {
        for (int i = 0; i < NV; i++) rate[NV + i] += N[i * NW + j] * along[j];
        for (int i = 0; i < NY; i++) y[i] += S[i * (NW + NV) + j] * along[j];
    }
    NAME_factor(M);
    NAME_solve(M, rate + NV);
    for (int j = 0; j < NV; j++)
        for (int i = 0; i < NY; i++) y[i] += S[i * (NW + NV) + NW + j] * rate[NV + j];
    for (size_t k = 0; k < rows; k++) {
        const Reference r = unknowns[k];
        if (r < X || r >= STEP) return ERROR;
        found[k] = r < DX ? along[r - X] : r < Y ? rate[r - DX] : y[r - Y];
    }
    return OK;
}

static int copy(void *to, const void *from, size_t size, size_t wanted)
{
    if (size == wanted) memcpy(to, from, size);
    return size == wanted ? OK : ERROR;
}

API void fmiNFreeInstance(Instance *of) { free(of); }
API int fmiNReset(Instance *of) { of->now = start; return OK; }
API int fmiNSetTime(Instance *of, double t) { of->now.t = t; return OK; }
API int fmiNSetContinuousStates(Instance *of, const double *x, size_t n) { return copy(of->now.x, x, n * 8, NX * 8); }
API int fmiNGetContinuousStates(Instance *of, double *x, size_t n) { return copy(x, of->now.x, n * 8, NX * 8); }
API int fmiNRATES(Instance *of, double *dx, size_t n) { NAME_rate(of->now.x, of->now.u, dx); return OK; }
API int fmiNGetNominalsOfContinuousStates(Instance *of, double *x, size_t n) { while (n--) x[n] = 1.0; return OK; }
API int fmiNGetEventIndicators(Instance *of, double *z, size_t n) { return n ? ERROR : OK; }
API int fmiNCompletedIntegratorStep(Instance *of, Flag last, Flag *event, Flag *end) { *event = *end = 0; return OK; }
API int fmiNSetDebugLogging(Instance *of, Flag on, size_t n, const String *categories) { return OK; }

API int fmiNGetFMUState(Instance *of, void **kept)
{
    if (!*kept) *kept = malloc(sizeof(State));
    return *kept ? copy(*kept, &of->now, sizeof(State), sizeof(State)) : ERROR;
}
API int fmiNSetFMUState(Instance *of, const State *kept) { of->now = *kept; return OK; }
API int fmiNFreeFMUState(Instance *of, void **kept) { if (kept) free(*kept), *kept = NULL; return OK; }
API int fmiNSerializedFMUStateSize(Instance *of, void *kept, size_t *n) { *n = sizeof(State); return OK; }
API int fmiNSerializeFMUState(Instance *of, void *kept, void *bytes, size_t n)
{ return copy(bytes, kept, n, sizeof(State)); }
API int fmiNDeserializeFMUState(Instance *of, const void *bytes, size_t n, void **kept)
{ return fmiNGetFMUState(of, kept) == OK ? copy(*kept, bytes, n, sizeof(State)) : ERROR; }

#define SAME(name) API int fmiN##name(Instance *of) { return OK; }
SAME(ExitInitializationMode) SAME(EnterEventMode) SAME(EnterContinuousTimeMode) SAME(Terminate)

/* Functions for what these instances do not have: other types, events at known times, clocks. */
#define NONE(name) API int fmiN##name(void) { return ERROR; }
#define NONE_OF(type) NONE(Get##type) NONE(Set##type)
NONE_OF(Boolean) NONE_OF(String)
