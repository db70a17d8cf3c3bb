/* Print the moments of a run, or the stationary moments, as CSV. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "road_class_change.h"

typedef road_class_change_real R;
enum { OUTPUTS = ROAD_CLASS_CHANGE_OUTPUTS > 0 ? ROAD_CLASS_CHANGE_OUTPUTS : 1, PARAMETERS = ROAD_CLASS_CHANGE_PARAMETERS > 0 ? ROAD_CLASS_CHANGE_PARAMETERS : 1, ROOM = 1024 };

static road_class_change_run run;
static road_class_change_stiff stiff;
static road_class_change_stationary_work work;
static R parameters[PARAMETERS], breakpoints[ROOM];

static const char usage[] =
    "usage: road_class_change [--duration T] [--points N] [--rtol R] [--stiff | --fixed STEPS] [--set NAME=VALUE]...\n"
    "       road_class_change --stationary SPEED [--at T] [--set NAME=VALUE]...\n"
    "       road_class_change --cost\n";

static int fail(const char *text)
{
    fprintf(stderr, "road_class_change: %s\n%s", text, usage);
    return 2;
}

static void print_names(void)
{
    printf("t");
    for (int i = 0; i < ROAD_CLASS_CHANGE_STATES; i++)
        printf(",mean %s", road_class_change_state_names[i]);
    for (int i = 0; i < ROAD_CLASS_CHANGE_OUTPUTS; i++)
        printf(",mean %s", road_class_change_output_names[i]);
    for (int i = 0; i < ROAD_CLASS_CHANGE_STATES; i++)
        for (int j = i; j < ROAD_CLASS_CHANGE_STATES; j++)
            if (i == j)
                printf(",variance %s", road_class_change_state_names[i]);
            else
                printf(",covariance %s %s", road_class_change_state_names[i], road_class_change_state_names[j]);
    for (int i = 0; i < ROAD_CLASS_CHANGE_OUTPUTS; i++)
        printf(",variance %s", road_class_change_output_names[i]);
    printf("\n");
}

static void print_row(R t, const R *y, const R *mean, const R *variance)
{
    printf("%.17g", (double)t);
    for (int i = 0; i < ROAD_CLASS_CHANGE_STATES; i++)
        printf(",%.17g", (double)y[i]);
    for (int i = 0; i < ROAD_CLASS_CHANGE_OUTPUTS; i++)
        printf(",%.17g", (double)mean[i]);
    for (int i = ROAD_CLASS_CHANGE_STATES; i < ROAD_CLASS_CHANGE_MOMENTS; i++)
        printf(",%.17g", (double)y[i]);
    for (int i = 0; i < ROAD_CLASS_CHANGE_OUTPUTS; i++)
        printf(",%.17g", (double)variance[i]);
    printf("\n");
}

static int set(const char *text)
{
    const char *equals = strchr(text, '=');
    if (!equals)
        return 0;
    for (int i = 0; i < ROAD_CLASS_CHANGE_PARAMETERS; i++)
        if (strlen(road_class_change_parameter_names[i]) == (size_t)(equals - text)
            && !strncmp(road_class_change_parameter_names[i], text, (size_t)(equals - text))) {
            parameters[i] = (R)atof(equals + 1);
            return 1;
        }
    return 0;
}

static int stationary(R speed, const char *at)
{
    static R y[ROAD_CLASS_CHANGE_SIZE];
    R mean[OUTPUTS], variance[OUTPUTS], motion[4];
    road_class_change_stationary_problem problem;
    if (ROAD_CLASS_CHANGE_EXPLICIT && !at)
        return fail("a rate depends on the time or the distance, so that nothing is stationary: freeze it with --at T");
    road_class_change_stationary_begin(&problem, speed, &work);
    problem.t = at ? (R)atof(at) : (R)0;
    road_class_change_motion(problem.t, parameters, motion);
    if (ROAD_CLASS_CHANGE_EXPLICIT && ROAD_CLASS_CHANGE_DISTANCE && problem.t != (R)0)
        return fail("the distance at a later time is known only by integration: freeze with --at 0");
    problem.s = ROAD_CLASS_CHANGE_DISTANCE ? motion[3] : motion[2];
    const road_class_change_status status = road_class_change_stationary(&problem, parameters, y);
    if (status != ROAD_CLASS_CHANGE_OK) {
        fprintf(stderr, "road_class_change: %s\n", road_class_change_status_text(status));
        return 1;
    }
    road_class_change_held_outputs(problem.t, problem.s, speed, y, parameters, mean, variance);
    print_names();
    print_row(problem.t, y, mean, variance);
    fprintf(stderr, "%s, residual %.1e, %d steps\n", problem.stable ? "stable" : "unstable", (double)problem.residual,
            problem.steps);
    return 0;
}

static int fixed(R duration, long steps, int points)
{
    static R y[ROAD_CLASS_CHANGE_SIZE], scratch[5 * ROAD_CLASS_CHANGE_SIZE];
    R mean[OUTPUTS], variance[OUTPUTS];
    const R step = duration / (R)steps;
    const long every = points > 1 && steps > points - 1 ? steps / (points - 1) : 1;
    road_class_change_initial(parameters, y);
    print_names();
    for (long k = 0; k <= steps; k++) {
        if (k % every == 0) {
            road_class_change_outputs(step * (R)k, y, parameters, mean, variance);
            print_row(step * (R)k, y, mean, variance);
        }
        if (k < steps)
            road_class_change_fixed_step(step * (R)k, step, y, parameters, scratch);
    }
    return 0;
}

static int propagate(R duration, int points, R rtol, int is_stiff)
{
    static R y[ROAD_CLASS_CHANGE_SIZE];
    R mean[OUTPUTS], variance[OUTPUTS];
    road_class_change_initial(parameters, y);
    road_class_change_begin(&run, (R)0, y);
    run.rtol = rtol;
    run.stiff = is_stiff ? &stiff : 0;
    run.breakpoints = breakpoints;
    run.breakpoint_count = road_class_change_breakpoints(parameters, duration, breakpoints, ROOM);
    if (run.breakpoint_count > ROOM)
        return fail("the run has more breakpoints than there is room for");
    print_names();
    for (int k = 0; k < points; k++) {
        const R t = points > 1 ? duration * (R)k / (R)(points - 1) : duration;
        const road_class_change_status status = road_class_change_propagate(&run, parameters, t);
        if (status != ROAD_CLASS_CHANGE_OK) {
            fprintf(stderr, "road_class_change: at t = %g: %s\n", (double)run.t, road_class_change_status_text(status));
            return 1;
        }
        road_class_change_outputs(t, run.y, parameters, mean, variance);
        print_row(t, run.y, mean, variance);
    }
    fprintf(stderr, "%ld steps, %ld refused, %ld rates\n", run.steps, run.refused, run.rates);
    return 0;
}

int main(int count, char **words)
{
    R duration = road_class_change_duration, rtol = (R)(sizeof(R) > 4 ? 1e-8 : 1e-4);
    int points = road_class_change_points, is_stiff = 0;
    long steps = 0;
    const char *speed = 0, *at = 0;
    for (int i = 0; i < ROAD_CLASS_CHANGE_PARAMETERS; i++)
        parameters[i] = road_class_change_default_parameters[i];
    for (int k = 1; k < count; k++) {
        if (!strcmp(words[k], "--stiff")) {
            is_stiff = 1;
            continue;
        }
        if (!strcmp(words[k], "--cost")) {
            printf("rate %d, outputs %d, fixed step %d operations\n", (int)ROAD_CLASS_CHANGE_RATE_OPERATIONS,
                   (int)ROAD_CLASS_CHANGE_OUTPUT_OPERATIONS, (int)ROAD_CLASS_CHANGE_STEP_OPERATIONS);
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
