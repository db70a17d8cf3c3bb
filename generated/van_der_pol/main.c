/* Print the moments of a run, or the stationary moments, as CSV. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "van_der_pol.h"

typedef van_der_pol_real R;
enum { OUTPUTS = VAN_DER_POL_OUTPUTS > 0 ? VAN_DER_POL_OUTPUTS : 1, PARAMETERS = VAN_DER_POL_PARAMETERS > 0 ? VAN_DER_POL_PARAMETERS : 1, ROOM = 1024 };

static van_der_pol_run run;
static van_der_pol_stiff stiff;
static van_der_pol_stationary_work work;
static R parameters[PARAMETERS], breakpoints[ROOM];

static const char usage[] =
    "usage: van_der_pol [--duration T] [--points N] [--rtol R] [--stiff | --fixed STEPS] [--set NAME=VALUE]...\n"
    "       van_der_pol --stationary SPEED [--at T] [--set NAME=VALUE]...\n"
    "       van_der_pol --cost\n";

static int fail(const char *text)
{
    fprintf(stderr, "van_der_pol: %s\n%s", text, usage);
    return 2;
}

static void print_names(void)
{
    printf("t");
    for (int i = 0; i < VAN_DER_POL_STATES; i++)
        printf(",mean %s", van_der_pol_state_names[i]);
    for (int i = 0; i < VAN_DER_POL_OUTPUTS; i++)
        printf(",mean %s", van_der_pol_output_names[i]);
    for (int i = 0; i < VAN_DER_POL_STATES; i++)
        for (int j = i; j < VAN_DER_POL_STATES; j++)
            if (i == j)
                printf(",variance %s", van_der_pol_state_names[i]);
            else
                printf(",covariance %s %s", van_der_pol_state_names[i], van_der_pol_state_names[j]);
    for (int i = 0; i < VAN_DER_POL_OUTPUTS; i++)
        printf(",variance %s", van_der_pol_output_names[i]);
    printf("\n");
}

static void print_row(R t, const R *y, const R *mean, const R *variance)
{
    printf("%.17g", (double)t);
    for (int i = 0; i < VAN_DER_POL_STATES; i++)
        printf(",%.17g", (double)y[i]);
    for (int i = 0; i < VAN_DER_POL_OUTPUTS; i++)
        printf(",%.17g", (double)mean[i]);
    for (int i = VAN_DER_POL_STATES; i < VAN_DER_POL_MOMENTS; i++)
        printf(",%.17g", (double)y[i]);
    for (int i = 0; i < VAN_DER_POL_OUTPUTS; i++)
        printf(",%.17g", (double)variance[i]);
    printf("\n");
}

static int set(const char *text)
{
    const char *equals = strchr(text, '=');
    if (!equals)
        return 0;
    for (int i = 0; i < VAN_DER_POL_PARAMETERS; i++)
        if (strlen(van_der_pol_parameter_names[i]) == (size_t)(equals - text)
            && !strncmp(van_der_pol_parameter_names[i], text, (size_t)(equals - text))) {
            parameters[i] = (R)atof(equals + 1);
            return 1;
        }
    return 0;
}

static int stationary(R speed, const char *at)
{
    static R y[VAN_DER_POL_SIZE];
    R mean[OUTPUTS], variance[OUTPUTS], motion[4];
    van_der_pol_stationary_problem problem;
    if (VAN_DER_POL_EXPLICIT && !at)
        return fail("a rate depends on the time or the distance, so that nothing is stationary: freeze it with --at T");
    van_der_pol_stationary_begin(&problem, speed, &work);
    problem.t = at ? (R)atof(at) : (R)0;
    van_der_pol_motion(problem.t, parameters, motion);
    if (VAN_DER_POL_EXPLICIT && VAN_DER_POL_DISTANCE && problem.t != (R)0)
        return fail("the distance at a later time is known only by integration: freeze with --at 0");
    problem.s = VAN_DER_POL_DISTANCE ? motion[3] : motion[2];
    const van_der_pol_status status = van_der_pol_stationary(&problem, parameters, y);
    if (status != VAN_DER_POL_OK) {
        fprintf(stderr, "van_der_pol: %s\n", van_der_pol_status_text(status));
        return 1;
    }
    van_der_pol_held_outputs(problem.t, problem.s, speed, y, parameters, mean, variance);
    print_names();
    print_row(problem.t, y, mean, variance);
    fprintf(stderr, "%s, residual %.1e, %d steps\n", problem.stable ? "stable" : "unstable", (double)problem.residual,
            problem.steps);
    return 0;
}

static int fixed(R duration, long steps, int points)
{
    static R y[VAN_DER_POL_SIZE], scratch[5 * VAN_DER_POL_SIZE];
    R mean[OUTPUTS], variance[OUTPUTS];
    const R step = duration / (R)steps;
    const long every = points > 1 && steps > points - 1 ? steps / (points - 1) : 1;
    van_der_pol_initial(parameters, y);
    print_names();
    for (long k = 0; k <= steps; k++) {
        if (k % every == 0) {
            van_der_pol_outputs(step * (R)k, y, parameters, mean, variance);
            print_row(step * (R)k, y, mean, variance);
        }
        if (k < steps)
            van_der_pol_fixed_step(step * (R)k, step, y, parameters, scratch);
    }
    return 0;
}

static int propagate(R duration, int points, R rtol, int is_stiff)
{
    static R y[VAN_DER_POL_SIZE];
    R mean[OUTPUTS], variance[OUTPUTS];
    van_der_pol_initial(parameters, y);
    van_der_pol_begin(&run, (R)0, y);
    run.rtol = rtol;
    run.stiff = is_stiff ? &stiff : 0;
    run.breakpoints = breakpoints;
    run.breakpoint_count = van_der_pol_breakpoints(parameters, duration, breakpoints, ROOM);
    if (run.breakpoint_count > ROOM)
        return fail("the run has more breakpoints than there is room for");
    print_names();
    for (int k = 0; k < points; k++) {
        const R t = points > 1 ? duration * (R)k / (R)(points - 1) : duration;
        const van_der_pol_status status = van_der_pol_propagate(&run, parameters, t);
        if (status != VAN_DER_POL_OK) {
            fprintf(stderr, "van_der_pol: at t = %g: %s\n", (double)run.t, van_der_pol_status_text(status));
            return 1;
        }
        van_der_pol_outputs(t, run.y, parameters, mean, variance);
        print_row(t, run.y, mean, variance);
    }
    fprintf(stderr, "%ld steps, %ld refused, %ld rates\n", run.steps, run.refused, run.rates);
    return 0;
}

int main(int count, char **words)
{
    R duration = van_der_pol_duration, rtol = (R)(sizeof(R) > 4 ? 1e-8 : 1e-4);
    int points = van_der_pol_points, is_stiff = 0;
    long steps = 0;
    const char *speed = 0, *at = 0;
    for (int i = 0; i < VAN_DER_POL_PARAMETERS; i++)
        parameters[i] = van_der_pol_default_parameters[i];
    for (int k = 1; k < count; k++) {
        if (!strcmp(words[k], "--stiff")) {
            is_stiff = 1;
            continue;
        }
        if (!strcmp(words[k], "--cost")) {
            printf("rate %d, outputs %d, fixed step %d operations\n", (int)VAN_DER_POL_RATE_OPERATIONS,
                   (int)VAN_DER_POL_OUTPUT_OPERATIONS, (int)VAN_DER_POL_STEP_OPERATIONS);
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
