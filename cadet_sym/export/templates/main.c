/* Print the moments of a run, or the stationary moments, as CSV. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "@p@.h"

typedef @p@_real R;
enum { OUTPUTS = @P@_OUTPUTS > 0 ? @P@_OUTPUTS : 1, PARAMETERS = @P@_PARAMETERS > 0 ? @P@_PARAMETERS : 1, ROOM = 1024 };

static @p@_run run;
static @p@_stiff stiff;
static @p@_stationary_work work;
static R parameters[PARAMETERS], breakpoints[ROOM];

static const char usage[] =
    "usage: @p@ [--duration T] [--points N] [--rtol R] [--stiff | --fixed STEPS] [--set NAME=VALUE]...\n"
    "       @p@ --stationary SPEED [--at T] [--set NAME=VALUE]...\n"
    "       @p@ --cost\n";

static int fail(const char *text)
{
    fprintf(stderr, "@p@: %s\n%s", text, usage);
    return 2;
}

static void print_names(void)
{
    printf("t");
    for (int i = 0; i < @P@_STATES; i++)
        printf(",mean %s", @p@_state_names[i]);
    for (int i = 0; i < @P@_OUTPUTS; i++)
        printf(",mean %s", @p@_output_names[i]);
    for (int i = 0; i < @P@_STATES; i++)
        for (int j = i; j < @P@_STATES; j++)
            if (i == j)
                printf(",variance %s", @p@_state_names[i]);
            else
                printf(",covariance %s %s", @p@_state_names[i], @p@_state_names[j]);
    for (int i = 0; i < @P@_OUTPUTS; i++)
        printf(",variance %s", @p@_output_names[i]);
    printf("\n");
}

static void print_row(R t, const R *y, const R *mean, const R *variance)
{
    printf("%.17g", (double)t);
    for (int i = 0; i < @P@_STATES; i++)
        printf(",%.17g", (double)y[i]);
    for (int i = 0; i < @P@_OUTPUTS; i++)
        printf(",%.17g", (double)mean[i]);
    for (int i = @P@_STATES; i < @P@_MOMENTS; i++)
        printf(",%.17g", (double)y[i]);
    for (int i = 0; i < @P@_OUTPUTS; i++)
        printf(",%.17g", (double)variance[i]);
    printf("\n");
}

static int set(const char *text)
{
    const char *equals = strchr(text, '=');
    if (!equals)
        return 0;
    for (int i = 0; i < @P@_PARAMETERS; i++)
        if (strlen(@p@_parameter_names[i]) == (size_t)(equals - text)
            && !strncmp(@p@_parameter_names[i], text, (size_t)(equals - text))) {
            parameters[i] = (R)atof(equals + 1);
            return 1;
        }
    return 0;
}

static int stationary(R speed, const char *at)
{
    static R y[@P@_SIZE];
    R mean[OUTPUTS], variance[OUTPUTS], motion[4];
    @p@_stationary_problem problem;
    if (@P@_EXPLICIT && !at)
        return fail("a rate depends on the time or the distance, so that nothing is stationary: freeze it with --at T");
    @p@_stationary_begin(&problem, speed, &work);
    problem.t = at ? (R)atof(at) : (R)0;
    @p@_motion(problem.t, parameters, motion);
    if (@P@_EXPLICIT && @P@_DISTANCE && problem.t != (R)0)
        return fail("the distance at a later time is known only by integration: freeze with --at 0");
    problem.s = @P@_DISTANCE ? motion[3] : motion[2];
    const @p@_status status = @p@_stationary(&problem, parameters, y);
    if (status != @P@_OK) {
        fprintf(stderr, "@p@: %s\n", @p@_status_text(status));
        return 1;
    }
    @p@_held_outputs(problem.t, problem.s, speed, y, parameters, mean, variance);
    print_names();
    print_row(problem.t, y, mean, variance);
    fprintf(stderr, "%s, residual %.1e, %d steps\n", problem.stable ? "stable" : "unstable", (double)problem.residual,
            problem.steps);
    return 0;
}

static int fixed(R duration, long steps, int points)
{
    static R y[@P@_SIZE], scratch[5 * @P@_SIZE];
    R mean[OUTPUTS], variance[OUTPUTS];
    const R step = duration / (R)steps;
    const long every = points > 1 && steps > points - 1 ? steps / (points - 1) : 1;
    @p@_initial(parameters, y);
    print_names();
    for (long k = 0; k <= steps; k++) {
        if (k % every == 0) {
            @p@_outputs(step * (R)k, y, parameters, mean, variance);
            print_row(step * (R)k, y, mean, variance);
        }
        if (k < steps)
            @p@_fixed_step(step * (R)k, step, y, parameters, scratch);
    }
    return 0;
}

static int propagate(R duration, int points, R rtol, int is_stiff)
{
    static R y[@P@_SIZE];
    R mean[OUTPUTS], variance[OUTPUTS];
    @p@_initial(parameters, y);
    @p@_begin(&run, (R)0, y);
    run.rtol = rtol;
    run.stiff = is_stiff ? &stiff : 0;
    run.breakpoints = breakpoints;
    run.breakpoint_count = @p@_breakpoints(parameters, duration, breakpoints, ROOM);
    if (run.breakpoint_count > ROOM)
        return fail("the run has more breakpoints than there is room for");
    print_names();
    for (int k = 0; k < points; k++) {
        const R t = points > 1 ? duration * (R)k / (R)(points - 1) : duration;
        const @p@_status status = @p@_propagate(&run, parameters, t);
        if (status != @P@_OK) {
            fprintf(stderr, "@p@: at t = %g: %s\n", (double)run.t, @p@_status_text(status));
            return 1;
        }
        @p@_outputs(t, run.y, parameters, mean, variance);
        print_row(t, run.y, mean, variance);
    }
    fprintf(stderr, "%ld steps, %ld refused, %ld rates\n", run.steps, run.refused, run.rates);
    return 0;
}

int main(int count, char **words)
{
    R duration = @p@_duration, rtol = (R)(sizeof(R) > 4 ? 1e-8 : 1e-4);
    int points = @p@_points, is_stiff = 0;
    long steps = 0;
    const char *speed = 0, *at = 0;
    for (int i = 0; i < @P@_PARAMETERS; i++)
        parameters[i] = @p@_default_parameters[i];
    for (int k = 1; k < count; k++) {
        if (!strcmp(words[k], "--stiff")) {
            is_stiff = 1;
            continue;
        }
        if (!strcmp(words[k], "--cost")) {
            printf("rate %d, outputs %d, fixed step %d operations\n", (int)@P@_RATE_OPERATIONS,
                   (int)@P@_OUTPUT_OPERATIONS, (int)@P@_STEP_OPERATIONS);
            return 0;
        }
        if (k + 1 >= count)
            return fail("wrong arguments");
        const char *value = words[k + 1];
        if (!strcmp(words[k], "--duration"))
            duration = (R)atof(value);
        else if (!strcmp(words[k], "--points"))
            points = atoi(value);
        else if (!strcmp(words[k], "--rtol"))
            rtol = (R)atof(value);
        else if (!strcmp(words[k], "--fixed"))
            steps = atol(value);
        else if (!strcmp(words[k], "--stationary"))
            speed = value;
        else if (!strcmp(words[k], "--at"))
            at = value;
        else if (strcmp(words[k], "--set") || !set(value))
            return fail("wrong arguments");
        k++;
    }
    if (!(duration >= (R)0) || points < 1 || !(rtol > (R)0) || steps < 0)
        return fail("wrong arguments");
    if (speed)
        return stationary((R)atof(speed), at);
    return steps > 0 ? fixed(duration, steps, points) : propagate(duration, points, rtol, is_stiff);
}
