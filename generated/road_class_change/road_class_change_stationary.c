/* Stationary moments: damped Newton, then pseudo-transient continuation, with checks of what was found. */
#include "road_class_change_real.h"

enum { SIZE = ROAD_CLASS_CHANGE_SIZE, STATES = ROAD_CLASS_CHANGE_STATES };
#define RESIDUAL (K(1e5) * ROUNDING) /* over the size of the equations' own terms */
#define STEP (K(1e2) * M(sqrt)(ROUNDING)) /* of the last Newton step over the standard deviations: its square is the error */

enum { RATE, FIRST, TRIAL, TRIAL_RATE, SCALE, OTHER, BEST, START, UNSTABLE, DIAGONAL, CORRECTION };

void road_class_change_stationary_begin(road_class_change_stationary_problem *problem, R speed, road_class_change_stationary_work *work)
{
    problem->speed = speed;
    problem->t = problem->s = K(0.0);
    problem->most_steps = 200;
    problem->residual = K(0.0);
    problem->steps = 0;
    problem->stable = 0;
    problem->work = work;
}

/* Rate and Jacobian values, those of drifting moments 0. */
static void rate_at(const road_class_change_stationary_problem *problem, const R *p, const R *y, R *rate)
{
    road_class_change_held_rate(problem->t, problem->s, problem->speed, y, p, rate);
    for (int i = 0; i < SIZE; i++)
        rate[i] = problem->work->left_out[i] ? K(0.0) : rate[i] - problem->work->vectors[CORRECTION][i];
}

static void jacobian_at(const road_class_change_stationary_problem *problem, const R *p, const R *y)
{
    road_class_change_stationary_work *work = problem->work;
    road_class_change_held_jacobian(problem->t, problem->s, problem->speed, y, p, work->values);
    for (int j = 0; j < SIZE; j++)
        for (int k = road_class_change_jacobian_column[j]; k < road_class_change_jacobian_column[j + 1]; k++)
            if (work->left_out[j] || work->left_out[road_class_change_jacobian_row[k]])
                work->values[k] = K(0.0);
}

/* Whether nothing but moments that are left out depends on a moment. */
static int unseen(const road_class_change_stationary_work *work, int moment)
{
    for (int k = road_class_change_jacobian_column[moment]; k < road_class_change_jacobian_column[moment + 1]; k++)
        if (work->values[k] != K(0.0) && !work->left_out[road_class_change_jacobian_row[k]])
            return 0;
    return 1;
}

static void leave_out(road_class_change_stationary_work *work, int state, int out)
{
    work->left_out[state] = out;
    for (int j = 0; j < STATES; j++)
        if (out || !work->left_out[j])
            work->left_out[road_class_change_covariance(state, j)] = out;
}

/* A state drifts if neither its own rate nor anything else depends on it, such as the height of an integrated road. */
static void find_drifting(road_class_change_stationary_problem *problem, const R *p, const R *y)
{
    road_class_change_stationary_work *work = problem->work;
    int found = 1;
    for (int i = 0; i < SIZE; i++)
        work->left_out[i] = 0;
    for (int i = 0; i < STATES; i++)
        problem->drifting[i] = 0;
    road_class_change_held_jacobian(problem->t, problem->s, problem->speed, y, p, work->values);
    while (found) {
        found = 0;
        for (int i = 0; i < STATES; i++) {
            int drifts = !problem->drifting[i] && unseen(work, i);
            if (!drifts)
                continue;
            leave_out(work, i, 1);
            for (int j = 0; drifts && j < STATES; j++)
                drifts = unseen(work, road_class_change_covariance(i, j));
            if (!drifts)
                leave_out(work, i, 0);
            problem->drifting[i] = drifts;
            found = found || drifts;
        }
    }
}

static int all_finite(const R *x)
{
    for (int i = 0; i < SIZE; i++)
        if (!FINITE(x[i]))
            return 0;
    return 1;
}

/* The size of every moment: standard deviations and their products. */
static void scales(const R *y, R *scale)
{
    R widest = K(0.0), ground = SMALLEST;
    for (int i = 0; i < STATES; i++) {
        const R variance = y[road_class_change_covariance(i, i)];
        scale[i] = variance > K(0.0) ? M(sqrt)(variance) : K(0.0);
        widest = scale[i] > widest ? scale[i] : widest;
    }
    for (int i = 0; i < STATES; i++) {
        const R least = K(1e6) * ROUNDING * M(fabs)(y[i]) + K(1e3) * ROUNDING * widest + M(sqrt)(M(sqrt)(SMALLEST));
        scale[i] = scale[i] > least ? scale[i] : least;
    }
    for (int j = 0, k = STATES; j < STATES; j++)
        for (int i = j; i < STATES; i++, k++)
            scale[k] = scale[i] * scale[j];
    for (int k = ROAD_CLASS_CHANGE_MOMENTS; k < SIZE; k++)
        ground = M(fabs)(y[k]) > ground ? M(fabs)(y[k]) : ground;
    for (int k = ROAD_CLASS_CHANGE_MOMENTS; k < SIZE; k++)
        scale[k] = ground;
}

static R size_of(const R *step, const R *scale)
{
    R largest = K(0.0);
    for (int i = 0; i < SIZE; i++) {
        const R ratio = M(fabs)(step[i]) / scale[i];
        if (!(ratio <= largest))
            largest = ratio;
    }
    return largest;
}

/* The largest of `wrong` over the size of the terms that make up each equation; values hold the Jacobian. What does not
 * depend on y is a term, too, and shows in the rate where the others are small. */
static R relative(const road_class_change_stationary_work *work, const R *y, const R *wrong, const R *rate, const R *scale, R *terms)
{
    R largest = K(0.0);
    for (int i = 0; i < SIZE; i++)
        terms[i] = M(fabs)(rate[i]) + SMALLEST;
    for (int j = 0; j < SIZE; j++) {
        const R size = M(fabs)(y[j]) > scale[j] ? M(fabs)(y[j]) : scale[j];
        for (int k = road_class_change_jacobian_column[j]; k < road_class_change_jacobian_column[j + 1]; k++)
            terms[road_class_change_jacobian_row[k]] += M(fabs)(work->values[k]) * size;
    }
    for (int i = 0; i < SIZE; i++) {
        const R ratio = M(fabs)(wrong[i]) / terms[i];
        if (!(ratio <= largest))
            largest = ratio;
    }
    return largest;
}

/* Jacobian at y less `shift`, decomposed. */
static int linearise(const road_class_change_stationary_problem *problem, const R *p, const R *y, R shift)
{
    road_class_change_stationary_work *work = problem->work;
    jacobian_at(problem, p, y);
    for (int i = 0; i < SIZE; i++)
        work->vectors[DIAGONAL][i] = -shift - (work->left_out[i] ? K(1.0) : K(0.0));
    return road_class_change_factorise(work->values, K(1.0), work->vectors[DIAGONAL], &work->factors);
}

/* x = -(J - shift)^-1 rate. */
static void newton_step(const road_class_change_stationary_work *work, const R *rate, R *x)
{
    for (int i = 0; i < SIZE; i++)
        x[i] = -rate[i];
    road_class_change_backsolve(&work->factors, x);
}

/* Damped by the natural monotonicity test (Deuflhard 2004, section 3.3), which does not depend on units. */
static road_class_change_status newton(road_class_change_stationary_problem *problem, const R *p, R *y, int most)
{
    road_class_change_stationary_work *work = problem->work;
    R *rate = work->vectors[RATE], *step = work->vectors[FIRST], *trial = work->vectors[TRIAL];
    R *there = work->vectors[TRIAL_RATE], *scale = work->vectors[SCALE], *other = work->vectors[OTHER];
    rate_at(problem, p, y, rate);
    for (int count = 0; count < most; count++) {
        R fraction = K(1.0);
        if (!all_finite(rate))
            return ROAD_CLASS_CHANGE_NOT_FINITE;
        if (!linearise(problem, p, y, K(0.0)))
            return ROAD_CLASS_CHANGE_SINGULAR;
        newton_step(work, rate, step);
        if (!all_finite(step))
            return ROAD_CLASS_CHANGE_SINGULAR;
        for (int i = 0; i < SIZE; i++)
            trial[i] = y[i] + step[i];
        scales(y, scale);
        problem->residual = relative(work, y, rate, rate, scale, other);
        scales(trial, other);
        for (int i = 0; i < SIZE; i++)
            scale[i] = other[i] > scale[i] ? other[i] : scale[i];
        const R length = size_of(step, scale);
        problem->steps++;
        if (problem->residual < RESIDUAL && length < STEP) {
            for (int i = 0; i < SIZE; i++)
                y[i] = trial[i];
            return ROAD_CLASS_CHANGE_OK;
        }
        for (; fraction > K(1e-2); fraction /= K(2.0)) {
            for (int i = 0; i < SIZE; i++)
                trial[i] = y[i] + fraction * step[i];
            rate_at(problem, p, trial, there);
            if (!all_finite(there))
                continue;
            newton_step(work, there, other);
            if (size_of(other, scale) <= (K(1.0) - fraction / K(4.0)) * length || length < K(1e2) * STEP)
                break;
        }
        if (!(fraction > K(1e-2)))
            return ROAD_CLASS_CHANGE_NO_CONVERGENCE;
        for (int i = 0; i < SIZE; i++) {
            y[i] = trial[i];
            rate[i] = there[i];
        }
    }
    return ROAD_CLASS_CHANGE_NO_CONVERGENCE;
}

/* Implicit steps of growing length along the equations (Kelley & Keyes, SIAM J. Numer. Anal. 35, 508, 1998). */
static road_class_change_status follow(road_class_change_stationary_problem *problem, const R *p, R *y)
{
    road_class_change_stationary_work *work = problem->work;
    R *rate = work->vectors[RATE], *step = work->vectors[FIRST], *trial = work->vectors[TRIAL];
    R *there = work->vectors[TRIAL_RATE], *scale = work->vectors[SCALE], *other = work->vectors[OTHER];
    R *kept = work->vectors[BEST];
    R h = K(0.0), tried = K(1e30);
    rate_at(problem, p, y, rate);
    if (!all_finite(rate))
        return ROAD_CLASS_CHANGE_NOT_FINITE;
    for (int count = 0; count < problem->most_steps; count++) {
        int good = linearise(problem, p, y, h > K(0.0) ? K(1.0) / h : K(0.0));
        R fastest = SMALLEST, residual, wrong = K(1e30);
        for (int k = 0; k < ROAD_CLASS_CHANGE_NONZEROS; k++)
            fastest = M(fabs)(work->values[k]) > fastest ? M(fabs)(work->values[k]) : fastest;
        if (!(h > K(0.0))) {
            h = K(1.0) / fastest;
            good = linearise(problem, p, y, K(1.0) / h);
        }
        scales(y, scale);
        residual = relative(work, y, rate, rate, scale, other);
        if (residual < K(1e-2) * tried && residual < K(1e-4)) {
            tried = residual;
            for (int i = 0; i < SIZE; i++)
                kept[i] = y[i];
            if (newton(problem, p, kept, 8) == ROAD_CLASS_CHANGE_OK) {
                for (int i = 0; i < SIZE; i++)
                    y[i] = kept[i];
                return ROAD_CLASS_CHANGE_OK;
            }
            rate_at(problem, p, y, rate);
            good = linearise(problem, p, y, K(1.0) / h);
        }
        problem->steps++;
        if (good)
            newton_step(work, rate, step);
        for (int i = 0; good && i < SIZE; i++)
            trial[i] = y[i] + step[i];
        for (int i = 0; good && i < STATES; i++)
            good = trial[road_class_change_covariance(i, i)] >= K(0.0);
        if (good) {
            rate_at(problem, p, trial, there);
            good = all_finite(there);
        }
        if (good) {
            scales(trial, scale);
            for (int i = 0; i < SIZE; i++)
                kept[i] = there[i] - step[i] / h;
            wrong = relative(work, trial, kept, rate, scale, other);
        }
        if (!good || !(wrong < K(0.5))) {
            h /= K(4.0);
            if (h * fastest < ROUNDING)
                return ROAD_CLASS_CHANGE_NO_CONVERGENCE;
            continue;
        }
        for (int i = 0; i < SIZE; i++) {
            y[i] = trial[i];
            rate[i] = there[i];
        }
        h *= wrong < K(0.1) ? K(4.0) : wrong < K(0.25) ? K(2.0) : K(1.0);
        if (h * fastest > K(1e3) / ROUNDING)
            h = K(1e3) / ROUNDING / fastest;
    }
    return ROAD_CLASS_CHANGE_NO_CONVERGENCE;
}

/* Whether a covariance is positive semidefinite up to rounding: Cholesky in units of the standard deviations. */
static int semidefinite(const road_class_change_stationary_problem *problem, const R *y, R *scale)
{
    R *matrix = problem->work->second;
    scales(y, scale);
    for (int j = 0; j < STATES; j++)
        for (int i = j; i < STATES; i++) {
            const int drifts = problem->drifting[i] || problem->drifting[j];
            R sum = drifts ? (R)(i == j) : y[road_class_change_covariance(i, j)] / (scale[i] * scale[j]);
            for (int k = 0; k < j; k++)
                sum -= matrix[k * STATES + i] * matrix[k * STATES + j];
            if (i == j) {
                if (!(sum > K(-1e7) * ROUNDING))
                    return 0;
                matrix[j * STATES + j] = sum > K(1e4) * ROUNDING ? M(sqrt)(sum) : K(0.0);
            } else {
                const R pivot = matrix[j * STATES + j];
                matrix[j * STATES + i] = pivot > K(0.0) ? sum / pivot : K(0.0);
            }
        }
    return 1;
}

/* The geometric mean of a shortest time, 1 / fastest, and of the longest that one inverse shows. */
static R middle_time(road_class_change_stationary_work *work, R fastest)
{
    R *x = work->vectors[OTHER], longest = K(0.0);
    for (int i = 0; i < SIZE; i++) {
        work->vectors[FIRST][i] = work->left_out[i] ? K(-1.0) : K(0.0);
        x[i] = work->left_out[i] ? K(0.0) : i % 2 ? K(1.0) : K(-1.0);
    }
    if (!road_class_change_factorise(work->values, K(1.0), work->vectors[FIRST], &work->factors))
        return K(1.0) / fastest;
    road_class_change_backsolve(&work->factors, x);
    for (int i = 0; i < SIZE; i++)
        longest = M(fabs)(x[i]) > longest ? M(fabs)(x[i]) : longest;
    return longest * fastest > K(1.0) && FINITE(longest) ? M(sqrt)(longest / fastest) : K(1.0) / fastest;
}

#if 0 > 0
/* Whether 2 (1 - hJ)^-1 - 1, applied again and again, makes vectors vanish: `factors` are those of 1 - hJ. */
static int dies_out(road_class_change_stationary_work *work)
{
    R *x = work->vectors[FIRST], *z = work->vectors[TRIAL];
    unsigned long random = 1;
    for (int start = 0; start < 3; start++) {
        int count = 0;
        R largest = K(1.0);
        for (int i = 0; i < SIZE; i++) {
            random = (random * 1103515245UL + 12345UL) & 0x7fffffffUL;
            x[i] = i >= ROAD_CLASS_CHANGE_ACTIVE ? K(0.0) : random & 0x10000UL ? K(1.0) : K(-1.0);
        }
        for (; largest > K(1e-8) && count < 20000; count++) {
            for (int i = 0; i < SIZE; i++)
                z[i] = x[i];
            road_class_change_backsolve(&work->factors, z);
            largest = K(0.0);
            for (int i = 0; i < SIZE; i++) {
                x[i] = K(2.0) * z[i] - x[i];
                largest = M(fabs)(x[i]) > largest || !FINITE(x[i]) ? M(fabs)(x[i]) : largest;
            }
            if (!(largest < K(1e12)))
                return 0;
        }
        if (count == 20000)
            return 0;
    }
    return 1;
}
#else
/* Whether 2 (1 - hJ)^-1 - 1, raised to growing powers, vanishes: `factors` are those of 1 - hJ. */
static int dies_out(road_class_change_stationary_work *work)
{
    R *power = work->second, *square = work->third;
    const int squarings = ROUNDING < K(1e-10) ? 32 : 20;
    for (int j = 0; j < SIZE; j++) {
        R *column = power + j * SIZE;
        for (int i = 0; i < SIZE; i++)
            column[i] = i == j ? K(2.0) : K(0.0);
        road_class_change_backsolve(&work->factors, column);
        column[j] -= K(1.0);
    }
    for (int count = 0; count <= squarings; count++) {
        R largest = K(0.0);
        for (int j = 0; j < SIZE; j++) {
            R sum = K(0.0);
            for (int i = 0; i < SIZE; i++)
                sum += M(fabs)(power[j * SIZE + i]);
            largest = sum > largest || !FINITE(sum) ? sum : largest;
        }
        if (largest < K(0.5))
            return 1;
        if (!(largest < K(1e15)))
            return 0;
        for (int j = 0; j < SIZE; j++) {
            R *column = square + j * SIZE;
            for (int i = 0; i < SIZE; i++)
                column[i] = K(0.0);
            for (int k = 0; k < SIZE; k++) {
                const R factor = power[j * SIZE + k];
                if (factor != K(0.0))
                    for (int i = 0; i < SIZE; i++)
                        column[i] += factor * power[k * SIZE + i];
            }
        }
        R *kept = power;
        power = square;
        square = kept;
    }
    return 0;
}
#endif

/* Whether small deviations die out: (1 - hJ)^-1 (1 + hJ) makes them vanish for any h > 0, soonest with h between the
 * shortest and the longest time of the system. */
static int stable_at(const road_class_change_stationary_problem *problem, const R *p, const R *y)
{
    road_class_change_stationary_work *work = problem->work;
    R *scale = work->vectors[SCALE];
    R norm = SMALLEST;
    scales(y, scale);
    jacobian_at(problem, p, y);
    for (int j = 0; j < SIZE; j++)
        for (int k = road_class_change_jacobian_column[j]; k < road_class_change_jacobian_column[j + 1]; k++) {
            work->values[k] *= scale[j] / scale[road_class_change_jacobian_row[k]];
            norm = M(fabs)(work->values[k]) > norm ? M(fabs)(work->values[k]) : norm;
        }
    for (int i = 0; i < SIZE; i++)
        work->vectors[DIAGONAL][i] = work->left_out[i] ? K(2.0) : K(1.0);
    const R h = middle_time(work, norm);
    return road_class_change_factorise(work->values, -h, work->vectors[DIAGONAL], &work->factors) && dies_out(work);
}

#if 0 > 0
/* The ground between wheels is carried along on a grid. Its error is known where nothing changes any more: take it out. */
static road_class_change_status refine(road_class_change_stationary_problem *problem, const R *p, R *y)
{
    road_class_change_stationary_work *work = problem->work;
    R *exact = work->vectors[TRIAL], *rate = work->vectors[RATE];
    road_class_change_status status = ROAD_CLASS_CHANGE_OK;
    for (int count = 0; count < 4 && status == ROAD_CLASS_CHANGE_OK && problem->speed > K(0.0); count++) {
        for (int i = 0; i < SIZE; i++)
            exact[i] = y[i];
        road_class_change_travelled(problem->t, problem->s, problem->speed, p, exact);
        road_class_change_held_rate(problem->t, problem->s, problem->speed, exact, p, rate);
        for (int i = ROAD_CLASS_CHANGE_HEAD; i < ROAD_CLASS_CHANGE_ACTIVE; i++)
            work->vectors[CORRECTION][i] = rate[i];
        for (int i = ROAD_CLASS_CHANGE_ACTIVE; i < SIZE; i++)
            y[i] = exact[i];
        status = newton(problem, p, y, 20);
    }
    return status;
}
#endif

road_class_change_status road_class_change_stationary(road_class_change_stationary_problem *problem, const R *p, R *y)
{
    road_class_change_stationary_work *work = problem->work;
    R *start = work->vectors[START];
    road_class_change_status status = ROAD_CLASS_CHANGE_NO_CONVERGENCE;
    R residual = K(0.0);
    int nothing = 1, unstable = 0, singular = 0;
    problem->steps = 0;
    problem->stable = 0;
    for (int i = 0; i < SIZE; i++)
        nothing = nothing && y[i] == K(0.0);
    for (int i = 0; nothing && i < STATES; i++)
        y[road_class_change_covariance(i, i)] = K(1e-8);
#if 0 > 0
    road_class_change_know_ground(problem->t, problem->s, p, y);
#endif
    for (int i = 0; i < SIZE; i++)
        start[i] = y[i];
    for (int i = 0; i < SIZE; i++)
        work->vectors[CORRECTION][i] = K(0.0);
    find_drifting(problem, p, y);
    for (int attempt = 0; attempt < 2; attempt++) {
        for (int i = 0; i < SIZE; i++)
            y[i] = start[i];
        status = attempt == 0 ? newton(problem, p, y, problem->most_steps < 40 ? problem->most_steps : 40)
                              : follow(problem, p, y);
#if 0 > 0
        status = status == ROAD_CLASS_CHANGE_OK ? refine(problem, p, y) : status;
#endif
        singular = singular || status == ROAD_CLASS_CHANGE_SINGULAR;
        if (status != ROAD_CLASS_CHANGE_OK)
            continue;
        rate_at(problem, p, y, work->vectors[RATE]);
        scales(y, work->vectors[SCALE]);
        problem->residual = relative(work, y, work->vectors[RATE], work->vectors[RATE], work->vectors[SCALE], work->vectors[OTHER]);
        if (!semidefinite(problem, y, work->vectors[SCALE])) {
            status = ROAD_CLASS_CHANGE_NOT_SEMIDEFINITE;
            continue;
        }
        problem->stable = stable_at(problem, p, y);
        if (problem->stable)
            break;
        unstable = 1;
        residual = problem->residual;
        for (int i = 0; i < SIZE; i++)
            work->vectors[UNSTABLE][i] = y[i];
    }
    if (status != ROAD_CLASS_CHANGE_OK && unstable) {
        status = ROAD_CLASS_CHANGE_OK;
        problem->residual = residual;
        for (int i = 0; i < SIZE; i++)
            y[i] = work->vectors[UNSTABLE][i];
    }
    for (int i = 0; i < SIZE; i++)
        if (work->left_out[i])
            y[i] = (R)NAN;
    return status == ROAD_CLASS_CHANGE_NO_CONVERGENCE && singular ? ROAD_CLASS_CHANGE_SINGULAR : status;
}

road_class_change_status road_class_change_start(const R *p, road_class_change_stationary_work *work, R *y)
{
    road_class_change_initial(p, y);
#if 0
    road_class_change_stationary_problem problem;
    R motion[4];
    road_class_change_motion(K(0.0), p, motion);
    road_class_change_stationary_begin(&problem, motion[0], work);
    problem.s = motion[3];
    return road_class_change_stationary(&problem, p, y);
#else
    (void)work;
    return ROAD_CLASS_CHANGE_OK;
#endif
}
