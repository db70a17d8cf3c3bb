/* Compare the library with what cadet-sym computed when it was written (reference.h), and with itself. */
#include <math.h>
#include <stdio.h>
#include "van_der_pol.h"
#include "reference.h"

typedef van_der_pol_real R;
enum { SIZE = VAN_DER_POL_SIZE, OUTPUTS = VAN_DER_POL_OUTPUTS > 0 ? VAN_DER_POL_OUTPUTS : 1, ROOM = 1024 };

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
    static R y[SIZE], other[SIZE], values[VAN_DER_POL_NONZEROS > 0 ? VAN_DER_POL_NONZEROS : 1], breakpoints[ROOM];
    static van_der_pol_run run;
    static van_der_pol_stiff stiff;
    R mean[OUTPUTS], variance[OUTPUTS];
    const R *p = van_der_pol_default_parameters;
    const R end = (R)run_end;

    van_der_pol_initial(p, y);
    check("initial", y, initial, SIZE, exact);
    for (int i = 0; i < SIZE; i++)
        y[i] = (R)sample_y[i];
    van_der_pol_rate((R)sample_t, y, p, other);
    check("rate", other, rate, SIZE, exact);
    van_der_pol_jacobian((R)sample_t, y, p, values);
    for (int i = 0; i < SIZE; i++)
        other[i] = (R)0;
    for (int j = 0; j < SIZE; j++)
        for (int k = van_der_pol_jacobian_column[j]; k < van_der_pol_jacobian_column[j + 1]; k++)
            other[van_der_pol_jacobian_row[k]] += values[k] * (R)size[j];
    check("jacobian", other, jacobian, SIZE, exact);
    van_der_pol_outputs((R)sample_t, y, p, mean, variance);
    check("means", mean, output_mean, VAN_DER_POL_OUTPUTS, exact);
    check("variances", variance, output_variance, VAN_DER_POL_OUTPUTS, exact);

    const int count = van_der_pol_breakpoints(p, van_der_pol_duration, breakpoints, ROOM);
    failures += count != breakpoint_count;
    printf("%-12s %s (%d)\n", "breakpoints", count == breakpoint_count ? "agree" : "DIFFER", count);
    for (int method = 0; method < (SIZE > 120 ? 1 : 2); method++) { /* full matrices take long for large models */
        van_der_pol_initial(p, y);
        van_der_pol_begin(&run, (R)0, y);
        run.rtol = (R)(sizeof(R) < 8 ? 1e-5 : 1e-7);
        run.stiff = method ? &stiff : 0;
        run.breakpoints = breakpoints;
        run.breakpoint_count = count < ROOM ? count : ROOM;
        const van_der_pol_status status = van_der_pol_propagate(&run, p, end);
        if (status != VAN_DER_POL_OK)
            printf("%s at t = %g\n", van_der_pol_status_text(status), (double)run.t);
        failures += status != VAN_DER_POL_OK;
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
