/* Integrate the moments: error-controlled explicit and stiff one-step methods, and fixed steps. */
#include "stop_and_go_real.h"

enum { SIZE = STOP_AND_GO_SIZE, STATES = STOP_AND_GO_STATES };

void stop_and_go_begin(stop_and_go_run *run, R t, const R *y)
{
    run->rtol = K(1e-6);
    run->floor = K(1e-4);
    run->longest_step = K(0.0);
    run->most_steps = 1000000;
    run->stiff = 0;
    run->breakpoints = 0;
    run->breakpoint_count = 0;
    run->t = t;
    run->step = K(0.0);
    run->steps = run->refused = run->rates = 0;
    run->settled = 0;
    run->fresh = 0;
    for (int i = 0; i < SIZE; i++) {
        run->y[i] = y[i];
        run->size[i] = K(0.0);
    }
}

/* The largest standard deviations so far say how large a mean or covariance may be. */
static void measure(stop_and_go_run *run)
{
    R deviation[STATES];
    R widest = K(0.0), ground = K(0.0);
    for (int i = 0; i < STATES; i++) {
        const R variance = run->y[stop_and_go_covariance(i, i)];
        deviation[i] = variance > K(0.0) ? M(sqrt)(variance) : K(0.0);
        widest = deviation[i] > widest ? deviation[i] : widest;
    }
    for (int i = 0; i < STATES; i++) {
        if (deviation[i] < K(1e-6) * widest)
            deviation[i] = K(1e-6) * widest;
        const R mean = M(fabs)(run->y[i]) > deviation[i] ? M(fabs)(run->y[i]) : deviation[i];
        if (mean > run->size[i])
            run->size[i] = mean;
    }
    for (int j = 0, k = STATES; j < STATES; j++)
        for (int i = j; i < STATES; i++, k++)
            if (deviation[i] * deviation[j] > run->size[k])
                run->size[k] = deviation[i] * deviation[j];
    for (int k = STOP_AND_GO_MOMENTS; k < SIZE; k++)
        if (M(fabs)(run->y[k]) > ground)
            ground = M(fabs)(run->y[k]);
    for (int k = STOP_AND_GO_MOMENTS; k < SIZE; k++)
        if (ground > run->size[k])
            run->size[k] = ground;
}

/* What an error of one entry is relative to. */
static R tolerance(const stop_and_go_run *run, int i, R before, R after)
{
    const R a = M(fabs)(before), b = M(fabs)(after);
    return run->rtol * ((a > b ? a : b) + run->floor * run->size[i]) + M(sqrt)(SMALLEST);
}

#if 5 > 0
/* Moments of the ground's own filters, which nothing but the distance moves: places in y, and the states of each (a
 * mean has its own twice). */
static const struct { int place, i, j; } filter[] = {
    {4, 4, 4}, {5, 5, 5}, {24, 4, 4}, {25, 5, 4}, {26, 5, 5}
};

/* Whether they are stationary: then they stay so, however fast the vehicle goes, and set no limit to the step. */
static void settle(stop_and_go_run *run, const R *p)
{
    R rate[SIZE], forcing[SIZE], still[SIZE], fastest = K(0.0), largest = K(0.0);
    for (int i = 0; i < SIZE; i++)
        still[i] = run->y[i];
    for (int k = 0; k < 5; k++)
        still[filter[k].place] = K(0.0);
    stop_and_go_held_rate(run->t, K(0.0), K(1.0), run->y, p, rate);
    stop_and_go_held_rate(run->t, K(0.0), K(1.0), still, p, forcing);
    for (int k = 0; k < 5; k++) {
        const R a = run->y[stop_and_go_covariance(filter[k].i, filter[k].i)], b = run->y[stop_and_go_covariance(filter[k].j, filter[k].j)];
        const R size = a > K(0.0) && b > K(0.0) ? M(sqrt)(a) * M(sqrt)(b) : K(0.0);
        fastest = M(fmax)(fastest, M(fabs)(forcing[filter[k].place]) / (size + SMALLEST));
        largest = M(fmax)(largest, M(fabs)(rate[filter[k].place]) / (size + SMALLEST));
    }
    run->settled = largest <= K(1e3) * ROUNDING * fastest ? 5 : 0;
}
#endif

/* The rate, but for what is settled. */
static void moving_rate(stop_and_go_run *run, R t, const R *y, const R *p, R *dy)
{
    stop_and_go_rate(t, y, p, dy);
    run->rates++;
#if 5 > 0
    for (int k = 0; k < run->settled; k++)
        dy[filter[k].place] = K(0.0);
#endif
}

/* Dormand & Prince, J. Comput. Appl. Math. 6, 19 (1980), 5(4); the last stage is the next step's first. */
static R explicit_step(stop_and_go_run *run, const R *p, R h, R last)
{
    const R *y = run->y;
    R *next = run->trial;
    R (*k)[STOP_AND_GO_SIZE] = run->stages;
    const R t = run->t;
    R sum = K(0.0);
    if (!run->fresh) {
        moving_rate(run, t, y, p, k[0]);
        run->fresh = 1;
    }
    for (int i = 0; i < SIZE; i++)
        next[i] = y[i] + h * (K(1.0) / K(5.0)) * k[0][i];
    moving_rate(run, t + h * (K(1.0) / K(5.0)), next, p, k[1]);
    for (int i = 0; i < SIZE; i++)
        next[i] = y[i] + h * (K(3.0) / K(40.0) * k[0][i] + K(9.0) / K(40.0) * k[1][i]);
    moving_rate(run, t + h * (K(3.0) / K(10.0)), next, p, k[2]);
    for (int i = 0; i < SIZE; i++)
        next[i] = y[i] + h * (K(44.0) / K(45.0) * k[0][i] - K(56.0) / K(15.0) * k[1][i] + K(32.0) / K(9.0) * k[2][i]);
    moving_rate(run, t + h * (K(4.0) / K(5.0)), next, p, k[3]);
    for (int i = 0; i < SIZE; i++)
        next[i] = y[i] + h * (K(19372.0) / K(6561.0) * k[0][i] - K(25360.0) / K(2187.0) * k[1][i]
                              + K(64448.0) / K(6561.0) * k[2][i] - K(212.0) / K(729.0) * k[3][i]);
    moving_rate(run, t + h * (K(8.0) / K(9.0)), next, p, k[4]);
    for (int i = 0; i < SIZE; i++)
        next[i] = y[i] + h * (K(9017.0) / K(3168.0) * k[0][i] - K(355.0) / K(33.0) * k[1][i]
                              + K(46732.0) / K(5247.0) * k[2][i] + K(49.0) / K(176.0) * k[3][i]
                              - K(5103.0) / K(18656.0) * k[4][i]);
    moving_rate(run, last, next, p, k[5]);
    for (int i = 0; i < SIZE; i++)
        next[i] = y[i] + h * (K(35.0) / K(384.0) * k[0][i] + K(500.0) / K(1113.0) * k[2][i]
                              + K(125.0) / K(192.0) * k[3][i] - K(2187.0) / K(6784.0) * k[4][i]
                              + K(11.0) / K(84.0) * k[5][i]);
    moving_rate(run, last, next, p, k[6]);
    for (int i = 0; i < SIZE; i++) {
        const R error = h * (K(71.0) / K(57600.0) * k[0][i] - K(71.0) / K(16695.0) * k[2][i]
                             + K(71.0) / K(1920.0) * k[3][i] - K(17253.0) / K(339200.0) * k[4][i]
                             + K(22.0) / K(525.0) * k[5][i] - K(1.0) / K(40.0) * k[6][i]);
        const R ratio = error / tolerance(run, i, y[i], next[i]);
        sum += ratio * ratio;
    }
    return M(sqrt)(sum / K(SIZE));
}

/* Rodas 4(3), six stages, stiffly accurate, L-stable (Hairer & Wanner, Solving ODEs II, 1996, section IV.7). */
static R stiff_step(stop_and_go_run *run, const R *p, R h, R last)
{
    static const R a[6][5] = {
        {K(0.0), K(0.0), K(0.0), K(0.0), K(0.0)},
        {K(1.544), K(0.0), K(0.0), K(0.0), K(0.0)},
        {K(0.9466785280815826), K(0.2557011698983284), K(0.0), K(0.0), K(0.0)},
        {K(3.314825187068521), K(2.896124015972201), K(0.9986419139977817), K(0.0), K(0.0)},
        {K(1.221224509226641), K(6.019134481288629), K(12.53708332932087), K(-0.6878860361058950), K(0.0)},
        {K(1.221224509226641), K(6.019134481288629), K(12.53708332932087), K(-0.6878860361058950), K(1.0)},
    };
    static const R c[6][5] = {
        {K(0.0), K(0.0), K(0.0), K(0.0), K(0.0)},
        {K(-5.6688), K(0.0), K(0.0), K(0.0), K(0.0)},
        {K(-2.430093356833875), K(-0.2063599157091915), K(0.0), K(0.0), K(0.0)},
        {K(-0.1073529058151375), K(-9.594562251023355), K(-20.47028614809616), K(0.0), K(0.0)},
        {K(7.496443313967647), K(-10.24680431464352), K(-33.99990352819905), K(11.70890893206160), K(0.0)},
        {K(8.083246795921522), K(-7.981132988064893), K(-31.52159432874371), K(16.31930543123136),
         K(-6.058818238834054)},
    };
    static const R alpha[6] = {K(0.0), K(0.386), K(0.21), K(0.63), K(1.0), K(1.0)};
    static const R gamma[6] = {K(0.25), K(-0.1043), K(0.1035), K(-0.0362), K(0.0), K(0.0)};
    stop_and_go_stiff *work = run->stiff;
    R (*k)[STOP_AND_GO_SIZE] = work->stages;
    R *next = run->trial;
    R sum = K(0.0);
    stop_and_go_jacobian(run->t, run->y, p, work->values);
    stop_and_go_slope(run->t, run->y, p, work->slope);
    for (int i = 0; i < SIZE; i++)
        work->diagonal[i] = K(1.0) / (K(0.25) * h);
    if (!stop_and_go_factorise(work->values, K(-1.0), work->diagonal, &work->factors))
        return K(1e10);
    for (int stage = 0; stage < 6; stage++) {
        for (int i = 0; i < SIZE; i++) {
            next[i] = run->y[i];
            for (int j = 0; j < stage; j++)
                next[i] += a[stage][j] * k[j][i];
        }
        stop_and_go_rate(stage < 4 ? run->t + alpha[stage] * h : last, next, p, k[stage]);
        run->rates++;
        for (int i = 0; i < SIZE; i++) {
            R right = k[stage][i] + h * gamma[stage] * work->slope[i];
            for (int j = 0; j < stage; j++)
                right += c[stage][j] / h * k[j][i];
            k[stage][i] = right;
        }
        stop_and_go_backsolve(&work->factors, k[stage]);
    }
    for (int i = 0; i < SIZE; i++) {
        next[i] += k[5][i];
        const R ratio = k[5][i] / tolerance(run, i, run->y[i], next[i]);
        sum += ratio * ratio;
    }
    return M(sqrt)(sum / K(SIZE));
}

/* A first step across which the moments change little. */
static R first_step(stop_and_go_run *run, const R *p, R length)
{
    R fastest = K(0.0);
    stop_and_go_rate(run->t, run->y, p, run->stages[0]);
    run->rates++;
    run->fresh = 1;
    for (int i = 0; i < SIZE; i++) {
        const R size = M(fabs)(run->y[i]) + run->size[i] + M(fabs)(run->stages[0][i]) * length + SMALLEST;
        const R rate = M(fabs)(run->stages[0][i]) / size;
        fastest = rate > fastest ? rate : fastest;
    }
    return M(fmin)(K(1e-3) * length, K(0.01) / (fastest + SMALLEST));
}

/* Integrate across a stretch without breakpoints; `last` is the latest time at which the inputs are those before it. */
static stop_and_go_status stretch(stop_and_go_run *run, const R *p, R until, R last, long *left)
{
    const R exponent = K(-1.0) / (run->stiff ? K(4.0) : K(5.0));
    if (!(run->step > K(0.0)))
        run->step = first_step(run, p, until - run->t);
    while (run->t < until) {
        const R rest = until - run->t;
        R h = run->step;
        int ends = 0;
        if (run->longest_step > K(0.0) && h > run->longest_step)
            h = run->longest_step;
        if (h >= rest) {
            h = rest;
            ends = 1;
        } else if (K(2.0) * h > rest) {
            h = rest / K(2.0);
        }
        if (!(run->t + h > run->t))
            return STOP_AND_GO_STEP_TOO_SMALL;
        if ((*left)-- <= 0)
            return STOP_AND_GO_TOO_MANY_STEPS;
        const R latest = ends ? last : run->t + h;
        const R error = run->stiff ? stiff_step(run, p, h, latest) : explicit_step(run, p, h, latest);
        const R factor = error > K(0.0) ? K(0.9) * M(pow)(error, exponent) : K(8.0);
        if (!FINITE(error)) {
            run->step = h / K(10.0);
            run->refused++;
            if (run->step < ROUNDING * rest)
                return STOP_AND_GO_NOT_FINITE;
            continue;
        }
        if (error > K(1.0)) {
            run->step = h * (factor < K(0.1) ? K(0.1) : factor);
            run->refused++;
            continue;
        }
        run->t = ends ? until : run->t + h;
        run->steps++;
        for (int i = 0; i < SIZE; i++) {
            run->y[i] = run->trial[i];
            run->stages[0][i] = run->stages[6][i];
        }
        measure(run);
        const R proposed = h * (factor > K(8.0) ? K(8.0) : factor);
        /* a step cut short by the end of the stretch says nothing about the next */
        if (proposed > run->step || !(h < run->step))
            run->step = proposed;
        run->fresh = run->stiff ? 0 : 1;
    }
    return STOP_AND_GO_OK;
}

stop_and_go_status stop_and_go_propagate(stop_and_go_run *run, const R *p, R until)
{
    long left = run->most_steps;
    measure(run);
#if 5 > 0
    settle(run, p);
#endif
    for (int k = 0; run->breakpoints && k < run->breakpoint_count; k++) {
        const R edge = run->breakpoints[k];
        if (!(edge > run->t) || !(edge <= until))
            continue;
        const stop_and_go_status status = stretch(run, p, edge, M(nextafter)(edge, run->t), &left);
        if (status != STOP_AND_GO_OK)
            return status;
        run->fresh = 0;
        run->step = K(0.0);
    }
    return run->t < until ? stretch(run, p, until, until, &left) : STOP_AND_GO_OK;
}

void stop_and_go_fixed_step(R t, R step, R *y, const R *p, R *work)
{
    R *k1 = work, *k2 = work + SIZE, *k3 = work + 2 * SIZE, *k4 = work + 3 * SIZE, *next = work + 4 * SIZE;
    const R half = step / K(2.0);
    stop_and_go_rate(t, y, p, k1);
    for (int i = 0; i < SIZE; i++)
        next[i] = y[i] + half * k1[i];
    stop_and_go_rate(t + half, next, p, k2);
    for (int i = 0; i < SIZE; i++)
        next[i] = y[i] + half * k2[i];
    stop_and_go_rate(t + half, next, p, k3);
    for (int i = 0; i < SIZE; i++)
        next[i] = y[i] + step * k3[i];
    stop_and_go_rate(t + step, next, p, k4);
    const R sixth = step / K(6.0);
    for (int i = 0; i < SIZE; i++)
        y[i] += sixth * (k1[i] + K(2.0) * (k2[i] + k3[i]) + k4[i]);
}
