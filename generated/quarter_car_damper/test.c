/* Compare the library with what cadet-sym computed when it was written (reference.h), and with itself. */
#include <math.h>
#include <stdio.h>
#include "quarter_car_damper.h"
#include "reference.h"

typedef quarter_car_damper_real R;
enum { SIZE = QUARTER_CAR_DAMPER_SIZE, OUTPUTS = QUARTER_CAR_DAMPER_OUTPUTS > 0 ? QUARTER_CAR_DAMPER_OUTPUTS : 1, ROOM = 1024 };

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
    static R y[SIZE], other[SIZE], values[QUARTER_CAR_DAMPER_NONZEROS > 0 ? QUARTER_CAR_DAMPER_NONZEROS : 1], breakpoints[ROOM];
    static quarter_car_damper_run run;
    static quarter_car_damper_stiff stiff;
    R mean[OUTPUTS], variance[OUTPUTS];
    const R *p = quarter_car_damper_default_parameters;
    const R end = (R)run_end;

    quarter_car_damper_initial(p, y);
    check("initial", y, initial, SIZE, exact);
    for (int i = 0; i < SIZE; i++)
        y[i] = (R)sample_y[i];
    quarter_car_damper_rate((R)sample_t, y, p, other);
    check("rate", other, rate, SIZE, exact);
    quarter_car_damper_jacobian((R)sample_t, y, p, values);
    for (int i = 0; i < SIZE; i++)
        other[i] = (R)0;
    for (int j = 0; j < SIZE; j++)
        for (int k = quarter_car_damper_jacobian_column[j]; k < quarter_car_damper_jacobian_column[j + 1]; k++)
            other[quarter_car_damper_jacobian_row[k]] += values[k] * (R)size[j];
    check("jacobian", other, jacobian, SIZE, exact);
    quarter_car_damper_outputs((R)sample_t, y, p, mean, variance);
    check("means", mean, output_mean, QUARTER_CAR_DAMPER_OUTPUTS, exact);
    check("variances", variance, output_variance, QUARTER_CAR_DAMPER_OUTPUTS, exact);

    const int count = quarter_car_damper_breakpoints(p, quarter_car_damper_duration, breakpoints, ROOM);
    failures += count != breakpoint_count;
    printf("%-12s %s (%d)\n", "breakpoints", count == breakpoint_count ? "agree" : "DIFFER", count);
    for (int method = 0; method < (SIZE > 120 ? 1 : 2); method++) { /* full matrices take long for large models */
        quarter_car_damper_initial(p, y);
        quarter_car_damper_begin(&run, (R)0, y);
        run.rtol = (R)(sizeof(R) < 8 ? 1e-5 : 1e-7);
        run.stiff = method ? &stiff : 0;
        run.breakpoints = breakpoints;
        run.breakpoint_count = count < ROOM ? count : ROOM;
        const quarter_car_damper_status status = quarter_car_damper_propagate(&run, p, end);
        if (status != QUARTER_CAR_DAMPER_OK)
            printf("%s at t = %g\n", quarter_car_damper_status_text(status), (double)run.t);
        failures += status != QUARTER_CAR_DAMPER_OK;
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
