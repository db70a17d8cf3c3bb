/* Compare the library with what cadet-sym computed when it was written (reference.h), and with itself. */
#include <math.h>
#include <stdio.h>
#include "road_class_change.h"
#include "reference.h"

typedef road_class_change_real R;
enum { SIZE = ROAD_CLASS_CHANGE_SIZE, OUTPUTS = ROAD_CLASS_CHANGE_OUTPUTS > 0 ? ROAD_CLASS_CHANGE_OUTPUTS : 1, ROOM = 1024 };

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
    static R y[SIZE], other[SIZE], values[ROAD_CLASS_CHANGE_NONZEROS > 0 ? ROAD_CLASS_CHANGE_NONZEROS : 1], breakpoints[ROOM];
    static road_class_change_run run;
    static road_class_change_stiff stiff;
    R mean[OUTPUTS], variance[OUTPUTS];
    const R *p = road_class_change_default_parameters;
    const R end = (R)run_end;

    road_class_change_initial(p, y);
    check("initial", y, initial, SIZE, exact);
    for (int i = 0; i < SIZE; i++)
        y[i] = (R)sample_y[i];
    road_class_change_rate((R)sample_t, y, p, other);
    check("rate", other, rate, SIZE, exact);
    road_class_change_jacobian((R)sample_t, y, p, values);
    for (int i = 0; i < SIZE; i++)
        other[i] = (R)0;
    for (int j = 0; j < SIZE; j++)
        for (int k = road_class_change_jacobian_column[j]; k < road_class_change_jacobian_column[j + 1]; k++)
            other[road_class_change_jacobian_row[k]] += values[k] * (R)size[j];
    check("jacobian", other, jacobian, SIZE, exact);
    road_class_change_outputs((R)sample_t, y, p, mean, variance);
    check("means", mean, output_mean, ROAD_CLASS_CHANGE_OUTPUTS, exact);
    check("variances", variance, output_variance, ROAD_CLASS_CHANGE_OUTPUTS, exact);

    const int count = road_class_change_breakpoints(p, road_class_change_duration, breakpoints, ROOM);
    failures += count != breakpoint_count;
    printf("%-12s %s (%d)\n", "breakpoints", count == breakpoint_count ? "agree" : "DIFFER", count);
    for (int method = 0; method < (SIZE > 120 ? 1 : 2); method++) { /* full matrices take long for large models */
        road_class_change_initial(p, y);
        road_class_change_begin(&run, (R)0, y);
        run.rtol = (R)(sizeof(R) < 8 ? 1e-5 : 1e-7);
        run.stiff = method ? &stiff : 0;
        run.breakpoints = breakpoints;
        run.breakpoint_count = count < ROOM ? count : ROOM;
        const road_class_change_status status = road_class_change_propagate(&run, p, end);
        if (status != ROAD_CLASS_CHANGE_OK)
            printf("%s at t = %g\n", road_class_change_status_text(status), (double)run.t);
        failures += status != ROAD_CLASS_CHANGE_OK;
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
