/* Compare the library with what cadet-sym computed when it was written (reference.h), and with itself. */
#include <math.h>
#include <stdio.h>
#include "@p@.h"
#include "reference.h"

typedef @p@_real R;
enum { SIZE = @P@_SIZE, OUTPUTS = @P@_OUTPUTS > 0 ? @P@_OUTPUTS : 1, ROOM = 1024 };

static int failures;
static const double exact = sizeof(R) > 4 ? 1e-10 : 1e-3; /* against numbers of 12 digits, or in single precision */

/* The largest difference over the largest value. */
static void check(const char *what, const R *found, const double *expected, int count, double tolerance)
{
    double largest = 0.0, wrong = 0.0;
    for (int i = 0; i < count; i++) {
        largest = fmax(largest, fabs(expected[i]));
        wrong = fmax(wrong, found[i] == found[i] ? fabs((double)found[i] - expected[i]) : HUGE_VAL);
    }
    const int good = wrong <= tolerance * largest || !(wrong > 0.0);
    printf("%-12s %s (%.1e of %.1e)\n", what, good ? "agrees" : "DIFFERS", wrong, largest);
    failures += !good;
}

int main(void)
{
    static R y[SIZE], other[SIZE], values[@P@_NONZEROS > 0 ? @P@_NONZEROS : 1], breakpoints[ROOM];
    static @p@_run run;
    static @p@_stiff stiff;
    R mean[OUTPUTS], variance[OUTPUTS];
    const R *p = @p@_default_parameters;
    const R end = (R)run_end;

    @p@_initial(p, y);
    check("initial", y, initial, SIZE, exact);
    for (int i = 0; i < SIZE; i++)
        y[i] = (R)sample_y[i];
    @p@_rate((R)sample_t, y, p, other);
    check("rate", other, rate, SIZE, exact);
    @p@_jacobian((R)sample_t, y, p, values);
    for (int i = 0; i < SIZE; i++)
        other[i] = (R)0;
    for (int j = 0; j < SIZE; j++)
        for (int k = @p@_jacobian_column[j]; k < @p@_jacobian_column[j + 1]; k++)
            other[@p@_jacobian_row[k]] += values[k] * (R)size[j];
    check("jacobian", other, jacobian, SIZE, exact);
    @p@_outputs((R)sample_t, y, p, mean, variance);
    check("means", mean, output_mean, @P@_OUTPUTS, exact);
    check("variances", variance, output_variance, @P@_OUTPUTS, exact);

    const int count = @p@_breakpoints(p, @p@_duration, breakpoints, ROOM);
    failures += count != breakpoint_count;
    printf("%-12s %s (%d)\n", "breakpoints", count == breakpoint_count ? "agree" : "DIFFER", count);
    for (int method = 0; method < (SIZE > 120 ? 1 : 2); method++) { /* full matrices take long for large models */
        @p@_initial(p, y);
        @p@_begin(&run, (R)0, y);
        run.rtol = (R)(sizeof(R) < 8 ? 1e-5 : 1e-7);
        run.stiff = method ? &stiff : 0;
        run.breakpoints = breakpoints;
        run.breakpoint_count = count < ROOM ? count : ROOM;
        const @p@_status status = @p@_propagate(&run, p, end);
        if (status != @P@_OK)
            printf("%s at t = %g\n", @p@_status_text(status), (double)run.t);
        failures += status != @P@_OK;
        double wrong = 0.0;
        for (int i = 0; i < SIZE; i++)
            wrong = fmax(wrong, fabs((double)run.y[i] - final[i]) / size[i]);
        const int good = wrong <= (sizeof(R) < 8 ? 1e-2 : 1e-4);
        printf("%-12s %s (%.1e)\n", method ? "run, stiff" : "run", good ? "agrees" : "DIFFERS", wrong);
        failures += !good;
    }
    printf(failures ? "%d failures\n" : "all well\n", failures);
    return failures != 0;
}
