/* One instance of the model as a functional mock-up unit; what FMI 2.0 and 3.0 have in common. Included once. */
#ifndef @P@_UNIT_H
#define @P@_UNIT_H
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "@p@.h"

#define TOKEN "@token@"

enum {
    SIZE = @P@_SIZE, PARAMETERS = @P@_PARAMETERS, OUTPUTS = @P@_OUTPUTS, ROOM = 1024,
    /* value references: the time, moments, their derivatives, parameters, means and variances of outputs */
    TIME = 0, MOMENT = 1, DERIVATIVE = MOMENT + SIZE, PARAMETER = DERIVATIVE + SIZE, MEAN = PARAMETER + PARAMETERS,
    VARIANCE = MEAN + OUTPUTS, REFERENCES = VARIANCE + OUTPUTS
};

typedef struct {
    double parameters[PARAMETERS > 0 ? PARAMETERS : 1];
    @p@_run run; /* run.t and run.y are the unit's time and state */
    double breakpoints[ROOM];
    double horizon, tolerance, rate[SIZE], mean[OUTPUTS > 0 ? OUTPUTS : 1], variance[OUTPUTS > 0 ? OUTPUTS : 1];
    int breakpoint_count, started, initial_stale, rate_stale, outputs_stale;
} @p@_unit_state;

typedef struct {
    @p@_unit_state now;
    @p@_stiff *stiff;
    @p@_stationary_work *work;
    void *environment;
    void (*log)(void *unit, int error, const char *text);
    const void *callbacks;
    void *extra;
    char name[64];
} @p@_unit;

static void @p@_unit_changed(@p@_unit *u)
{
    u->now.rate_stale = u->now.outputs_stale = 1;
    u->now.run.fresh = 0;
}

static void @p@_unit_reset(@p@_unit *u)
{
    memset(&u->now, 0, sizeof u->now);
    for (int i = 0; i < PARAMETERS; i++)
        u->now.parameters[i] = @p@_default_parameters[i];
    u->now.horizon = @p@_duration;
    u->now.tolerance = 1e-7;
    u->now.initial_stale = 1;
    @p@_unit_changed(u);
}

static @p@_unit *@p@_unit_new(const char *name)
{
    @p@_unit *u = calloc(1, sizeof *u);
    if (!u)
        return 0;
    u->stiff = calloc(1, sizeof *u->stiff);
    u->work = @P@_STEADY_START ? calloc(1, sizeof *u->work) : 0;
    if (!u->stiff || (@P@_STEADY_START && !u->work)) {
        free(u->stiff);
        free(u->work);
        free(u);
        return 0;
    }
    snprintf(u->name, sizeof u->name, "%s", name ? name : "");
    @p@_unit_reset(u);
    return u;
}

static void @p@_unit_free(@p@_unit *u)
{
    if (u) {
        free(u->stiff);
        free(u->work);
        free(u);
    }
}

static int @p@_unit_fail(@p@_unit *u, const char *text)
{
    u->log(u, 1, text);
    return 0;
}

/* The moments at the start follow from the parameters as they are when the initialisation ends. */
static int @p@_unit_start(@p@_unit *u)
{
    double y[SIZE];
    if (!u->now.initial_stale)
        return 1;
    const @p@_status status = @p@_start(u->now.parameters, u->work, y);
    if (status != @P@_OK)
        return @p@_unit_fail(u, @p@_status_text(status));
    for (int i = 0; i < SIZE; i++)
        if (!isfinite(y[i]))
            return @p@_unit_fail(u, "the moments at the start are not numbers: check the parameters");
    @p@_begin(&u->now.run, u->now.run.t, y);
    u->now.initial_stale = 0;
    @p@_unit_changed(u);
    return 1;
}

static int @p@_unit_find_breakpoints(@p@_unit *u)
{
    u->now.breakpoint_count = @p@_breakpoints(u->now.parameters, u->now.horizon, u->now.breakpoints, ROOM);
    return u->now.breakpoint_count <= ROOM ? 1 : @p@_unit_fail(u, "the run has more breakpoints than there is room for");
}

static int @p@_unit_initialise(@p@_unit *u, double start, double stop)
{
    if (start != 0.0)
        return @p@_unit_fail(u, "the moments at the start are those at t = 0: begin there");
    u->now.run.t = start;
    if (stop > u->now.horizon)
        u->now.horizon = stop;
    return 1;
}

static int @p@_unit_initialised(@p@_unit *u)
{
    u->now.started = 1;
    return @p@_unit_start(u) && @p@_unit_find_breakpoints(u);
}

static const double *@p@_unit_rate(@p@_unit *u)
{
    if (u->now.rate_stale)
        @p@_rate(u->now.run.t, u->now.run.y, u->now.parameters, u->now.rate);
    u->now.rate_stale = 0;
    return u->now.rate;
}

static int @p@_unit_get(@p@_unit *u, const unsigned int *references, size_t count, double *values)
{
    for (size_t k = 0; k < count; k++) {
        const int r = references[k] < REFERENCES ? (int)references[k] : REFERENCES;
        if (r >= REFERENCES)
            return @p@_unit_fail(u, "there is no variable of this value reference");
        if (r >= PARAMETER && r < MEAN) {
            values[k] = u->now.parameters[r - PARAMETER];
            continue;
        }
        if (!@p@_unit_start(u))
            return 0;
        if (r >= MEAN && u->now.outputs_stale) {
            @p@_outputs(u->now.run.t, u->now.run.y, u->now.parameters, u->now.mean, u->now.variance);
            u->now.outputs_stale = 0;
        }
        values[k] = r == TIME          ? u->now.run.t
                    : r < DERIVATIVE   ? u->now.run.y[r - MOMENT]
                    : r < PARAMETER    ? @p@_unit_rate(u)[r - DERIVATIVE]
                    : r < VARIANCE     ? u->now.mean[r - MEAN]
                                       : u->now.variance[r - VARIANCE];
    }
    return 1;
}

static int @p@_unit_set(@p@_unit *u, const unsigned int *references, size_t count, const double *values)
{
    for (size_t k = 0; k < count; k++) {
        if (references[k] < PARAMETER || references[k] >= MEAN)
            return @p@_unit_fail(u, "only parameters can be set");
        if (!isfinite(values[k]))
            return @p@_unit_fail(u, "a parameter must be a finite number");
        u->now.parameters[references[k] - PARAMETER] = values[k];
    }
    if (count == 0)
        return 1;
    @p@_unit_changed(u);
    if (!u->now.started)
        u->now.initial_stale = 1;
    else
        return @p@_unit_find_breakpoints(u);
    return 1;
}
#endif
