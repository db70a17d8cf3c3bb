/* FMI 2.0 co-simulation: steps of any length, each as accurate as the tolerance asks for. */
#include "unit.h"
#include "fmi2Functions.h"

static void log_text(void *instance, int error, const char *text)
{
    const @p@_unit *u = instance;
    const fmi2CallbackFunctions *functions = u->callbacks;
    if (functions && functions->logger)
        functions->logger(functions->componentEnvironment, u->name, error ? fmi2Error : fmi2OK,
                          error ? "logStatusError" : "logAll", "%s", text);
}

static fmi2Status status(int good)
{
    return good ? fmi2OK : fmi2Error;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String place,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)place;
    (void)visible;
    (void)logging;
    @p@_unit *u = type == fmi2CoSimulation && token && !strcmp(token, TOKEN) ? @p@_unit_new(name) : 0;
    if (u) {
        u->callbacks = functions;
        u->log = log_text;
    }
    return u;
}

void fmi2FreeInstance(fmi2Component c) { @p@_unit_free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stops, fmi2Real stop)
{
    @p@_unit *u = c;
    if (tolerant && tolerance > 0)
        u->now.tolerance = tolerance;
    return status(@p@_unit_initialise(u, start, stops ? stop : 0));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return status(@p@_unit_initialised(c)); }

fmi2Status fmi2Terminate(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    @p@_unit_reset(c);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real step, fmi2Boolean final)
{
    @p@_unit *u = c;
    @p@_run *run = &u->now.run;
    const double until = now + step;
    (void)final;
    if (!(fabs(now - run->t) <= 1e-9 * (fabs(now) + step)) || !(step > 0))
        return status(@p@_unit_fail(u, "a step must begin where the last one ended, and be longer than nothing"));
    if (until > u->now.horizon * (1 + 1e-9)) {
        u->now.horizon = 2 * until;
        if (!@p@_unit_find_breakpoints(u))
            return fmi2Error;
    }
    run->rtol = u->now.tolerance;
    run->breakpoints = u->now.breakpoints;
    run->breakpoint_count = u->now.breakpoint_count;
    run->most_steps = 100000;
    @p@_status found = @p@_propagate(run, u->now.parameters, until);
    if (found == @P@_TOO_MANY_STEPS && !run->stiff) {
        run->stiff = u->stiff;
        run->step = 0;
        found = @p@_propagate(run, u->now.parameters, until);
    }
    u->now.rate_stale = u->now.outputs_stale = 1;
    return status(found == @P@_OK || @p@_unit_fail(u, @p@_status_text(found)));
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    (void)c;
    return fmi2Error;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[])
{
    return status(@p@_unit_get(c, r, n, v));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[])
{
    return status(@p@_unit_set(c, r, n, v));
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (!*state)
        *state = malloc(sizeof(@p@_unit_state));
    if (*state)
        memcpy(*state, &((@p@_unit *)c)->now, sizeof(@p@_unit_state));
    return status(*state != 0);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    @p@_unit *u = c;
    memcpy(&u->now, state, sizeof(@p@_unit_state));
    u->now.run.breakpoints = u->now.breakpoints;
    u->now.run.stiff = u->now.run.stiff ? u->stiff : 0;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = 0;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c;
    (void)state;
    *size = sizeof(@p@_unit_state);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    (void)c;
    if (size < sizeof(@p@_unit_state))
        return fmi2Error;
    memcpy(bytes, state, sizeof(@p@_unit_state));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    (void)c;
    if (size != sizeof(@p@_unit_state))
        return fmi2Error;
    if (!*state)
        *state = malloc(sizeof(@p@_unit_state));
    if (*state)
        memcpy(*state, bytes, sizeof(@p@_unit_state));
    return status(*state != 0);
}

/* What this unit has none of. */
@stubs@
