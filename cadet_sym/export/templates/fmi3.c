/* FMI 3.0 model exchange: the moment equations for a solver of the importer. */
#include "unit.h"
#include "fmi3Functions.h"

static void log_text(void *instance, int error, const char *text)
{
    const @p@_unit *u = instance;
    if (u->callbacks)
        (*(const fmi3LogMessageCallback *)u->callbacks)(u->environment, error ? fmi3Error : fmi3OK,
                                                        error ? "logStatusError" : "logAll", text);
}

static fmi3Status status(int good)
{
    return good ? fmi3OK : fmi3Error;
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    (void)place;
    (void)visible;
    (void)logging;
    @p@_unit *u = token && !strcmp(token, TOKEN) ? @p@_unit_new(name) : 0;
    fmi3LogMessageCallback *callback = u ? malloc(sizeof *callback) : 0;
    if (!callback) {
        @p@_unit_free(u);
        return 0;
    }
    *callback = log;
    u->callbacks = log ? callback : 0;
    u->extra = callback;
    u->environment = environment;
    u->log = log_text;
    return u;
}

void fmi3FreeInstance(fmi3Instance c)
{
    if (c)
        free(((@p@_unit *)c)->extra);
    @p@_unit_free(c);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerant, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean stops, fmi3Float64 stop)
{
    (void)tolerant;
    (void)tolerance;
    return status(@p@_unit_initialise(c, start, stops ? stop : 0));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return status(@p@_unit_initialised(c)); }

fmi3Status fmi3Reset(fmi3Instance c)
{
    @p@_unit_reset(c);
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 v[], size_t m)
{
    return status(n == m && @p@_unit_get(c, r, n, v));
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[], size_t m)
{
    return status(n == m && @p@_unit_set(c, r, n, v));
}

/* The next breakpoint of the run is a time event. */
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *end, fmi3Boolean *nominals,
                                    fmi3Boolean *values, fmi3Boolean *timed, fmi3Float64 *next)
{
    const @p@_unit *u = c;
    *again = *end = *nominals = *values = *timed = fmi3False;
    for (int k = 0; k < u->now.breakpoint_count && !*timed; k++)
        if (u->now.breakpoints[k] > u->now.run.t * (1 + 1e-12)) {
            *timed = fmi3True;
            *next = u->now.breakpoints[k];
        }
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean final, fmi3Boolean *event, fmi3Boolean *end)
{
    (void)c;
    (void)final;
    *event = *end = fmi3False;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time)
{
    @p@_unit *u = c;
    u->now.run.t = time;
    @p@_unit_changed(u);
    return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 y[], size_t n)
{
    @p@_unit *u = c;
    if (n != SIZE)
        return fmi3Error;
    memcpy(u->now.run.y, y, sizeof u->now.run.y);
    @p@_unit_changed(u);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 y[], size_t n)
{
    @p@_unit *u = c;
    if (n != SIZE || !@p@_unit_start(u))
        return fmi3Error;
    memcpy(y, u->now.run.y, sizeof u->now.run.y);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 rate[], size_t n)
{
    @p@_unit *u = c;
    if (n != SIZE || !@p@_unit_start(u))
        return fmi3Error;
    memcpy(rate, @p@_unit_rate(u), sizeof u->now.rate);
    for (int i = 0; i < SIZE; i++)
        if (!isfinite(rate[i]))
            return fmi3Discard;
    return fmi3OK;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominals[], size_t n)
{
    static const double sizes[SIZE] = {
@nominals@
    };
    (void)c;
    if (n != SIZE)
        return fmi3Error;
    memcpy(nominals, sizes, sizeof sizes);
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *count)
{
    (void)c;
    *count = SIZE;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *count)
{
    (void)c;
    *count = 0;
    return fmi3OK;
}

#define NOTHING_TO_DO(function)                                                                                         \
    fmi3Status function(fmi3Instance c)                                                                                 \
    {                                                                                                                   \
        (void)c;                                                                                                        \
        return fmi3OK;                                                                                                  \
    }
NOTHING_TO_DO(fmi3EnterEventMode)
NOTHING_TO_DO(fmi3EnterContinuousTimeMode)
NOTHING_TO_DO(fmi3EvaluateDiscreteStates)
NOTHING_TO_DO(fmi3Terminate)
NOTHING_TO_DO(fmi3EnterConfigurationMode)
NOTHING_TO_DO(fmi3ExitConfigurationMode)

/* What this unit has none of. */
@stubs@
