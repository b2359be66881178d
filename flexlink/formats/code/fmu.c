/* What FMI 2.0 and 3.0 have in common. fmiN stands for fmi2 or fmi3, Flag for their type of truth values. */
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define API __declspec(dllexport)
#elif defined(__GNUC__)
#define API __attribute__((visibility("default")))
#else
#define API
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

/* The status, which is also logged with a message unless it is OK. */
static int told(Instance *of, int status, String message);

static Instance *begin(String name, String token, void *environment, void *log)
{
    Instance *made = strcmp(token, "TOKEN") ? NULL : malloc(sizeof *made);
    if (made) *made = (Instance){start, environment, log, ""};
    if (made) strncpy(made->name, name, sizeof made->name - 1);
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
        if (r == TIME) values[k] = now->t;
        else if (r < X) values[k] = now->u[r - U];
        else if (r < DX) values[k] = now->x[r - X];
        else if (r < Y) values[k] = dx[r - DX];
        else if (r < STEP) values[k] = y[r - Y];
        else if (r == STEP) values[k] = now->step;
        else return ERROR;
    }
    return OK;
}

static int set(State *now, const Reference *to, size_t count, const double *values)
{
    for (size_t k = 0; k < count; k++) {
        const Reference r = to[k];
        if (!isfinite(values[k])) return ERROR;
        if (r >= U && r < X) now->u[r - U] = values[k];
        else if (r >= X && r < DX) now->x[r - X] = values[k];
        else if (r == STEP && values[k] > 0.0) now->step = values[k];
        else return ERROR;
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

/* Derivatives of unknowns in the direction `seed` of the knowns: M dv' = N (dx, du), dy = S (dx, du). */
static int directional(const State *now, const Reference *unknowns, size_t rows, const Reference *knowns,
                       size_t columns, const double *seed, double *found)
{
    double M[NV * NV], N[NV * NW], S[NY * NW], along[NW] = {0.0}, rate[NX], y[NY] = {0.0};
    for (size_t k = 0; k < columns; k++)
        if (knowns[k] >= U && knowns[k] < X) along[NX + knowns[k] - U] += seed[k];
        else if (knowns[k] >= X && knowns[k] < DX) along[knowns[k] - X] += seed[k];
        else return ERROR;
    NAME_implicit(now->x, now->u, M, N);
    NAME_output_slopes(now->x, now->u, S);
    for (int i = 0; i < NV; i++) {
        rate[i] = along[NV + i];
        rate[NV + i] = 0.0;
        for (int j = 0; j < NW; j++) rate[NV + i] += N[i * NW + j] * along[j];
    }
    NAME_factor(M);
    NAME_solve(M, rate + NV);
    for (int i = 0; i < NY; i++)
        for (int j = 0; j < NW; j++) y[i] += S[i * NW + j] * along[j];
    for (size_t k = 0; k < rows; k++) {
        const Reference r = unknowns[k];
        if (r >= X && r < DX) found[k] = along[r - X];
        else if (r >= DX && r < Y) found[k] = rate[r - DX];
        else if (r >= Y && r < STEP) found[k] = y[r - Y];
        else return ERROR;
    }
    return OK;
}

static int copy_states(double *to, const double *from, size_t count)
{
    if (count != NX) return ERROR;
    memcpy(to, from, sizeof(double) * NX);
    return OK;
}

static int copy_bytes(void *to, const void *from, size_t size)
{
    if (size != sizeof(State)) return ERROR;
    memcpy(to, from, size);
    return OK;
}

API void fmiNFreeInstance(Instance *of) { free(of); }
API int fmiNReset(Instance *of) { of->now = start; return OK; }
API int fmiNSetTime(Instance *of, double t) { of->now.t = t; return OK; }
API int fmiNSetContinuousStates(Instance *of, const double *x, size_t n) { return copy_states(of->now.x, x, n); }
API int fmiNGetContinuousStates(Instance *of, double *x, size_t n) { return copy_states(x, of->now.x, n); }
API int fmiNRATES(Instance *of, double *dx, size_t n)
{ if (n != NX) return ERROR; NAME_rate(of->now.x, of->now.u, dx); return OK; }
API int fmiNGetNominalsOfContinuousStates(Instance *of, double *nominal, size_t n)
{ (void)of; for (size_t k = 0; k < n; k++) nominal[k] = 1.0; return OK; }
API int fmiNGetEventIndicators(Instance *of, double *z, size_t n) { (void)of; (void)z; return n ? ERROR : OK; }
API int fmiNCompletedIntegratorStep(Instance *of, Flag last, Flag *event, Flag *end)
{ (void)of; (void)last; *event = *end = 0; return OK; }
API int fmiNSetDebugLogging(Instance *of, Flag on, size_t n, const String *categories)
{ (void)of; (void)on; (void)n; (void)categories; return OK; }

API int fmiNGetFMUState(Instance *of, void **kept)
{
    if (!*kept) *kept = malloc(sizeof(State));
    if (!*kept) return ERROR;
    return copy_bytes(*kept, &of->now, sizeof(State));
}
API int fmiNSetFMUState(Instance *of, const State *kept) { of->now = *kept; return OK; }
API int fmiNFreeFMUState(Instance *of, void **kept) { (void)of; free(*kept); *kept = NULL; return OK; }
API int fmiNSerializedFMUStateSize(Instance *of, void *kept, size_t *size)
{ (void)of; (void)kept; *size = sizeof(State); return OK; }
API int fmiNSerializeFMUState(Instance *of, void *kept, unsigned char *bytes, size_t size)
{ (void)of; return copy_bytes(bytes, kept, size); }
API int fmiNDeserializeFMUState(Instance *of, const unsigned char *bytes, size_t size, void **kept)
{ return fmiNGetFMUState(of, kept) == OK ? copy_bytes(*kept, bytes, size) : ERROR; }

#define SAME(name) API int fmiN##name(Instance *of) { (void)of; return OK; }
SAME(ExitInitializationMode) SAME(EnterEventMode) SAME(EnterContinuousTimeMode) SAME(Terminate)

/* Functions for what these instances do not have: other types, events at known times, clocks. */
#define NONE(name) API int fmiN##name(void) { return ERROR; }
#define NONE_OF(type) NONE(Get##type) NONE(Set##type)
NONE_OF(Boolean) NONE_OF(String)
