/* Times at which a known input changes abruptly: signs compared on a grid, then bisection. */
#include "half_car_acceleration_real.h"

enum { CELLS = 2048, SWITCHES = HALF_CAR_ACCELERATION_SWITCHES };

#if 0 > 0
/* Distance travelled from `begin` to `end`: the speed integrated by eight Gauss points. */
static R travelled(const R *p, R begin, R end)
{
    static const R node[4] = {K(0.1834346424956498), K(0.5255324099163290), K(0.7966664774136267), K(0.9602898564975363)};
    static const R weight[4] = {K(0.3626837833783620), K(0.3137066458778873), K(0.2223810344533745),
                                K(0.1012285362903763)};
    const R half = (end - begin) / K(2.0), middle = (begin + end) / K(2.0);
    R sum = K(0.0), motion[4];
    for (int k = 0; k < 4; k++) {
        half_car_acceleration_motion(middle - half * node[k], p, motion);
        sum += weight[k] * motion[0];
        half_car_acceleration_motion(middle + half * node[k], p, motion);
        sum += weight[k] * motion[0];
    }
    return half * sum;
}

static R distance(const R *p, R begin, R from, R t)
{
    R motion[4];
    if (HALF_CAR_ACCELERATION_DISTANCE)
        return from + travelled(p, begin, t);
    half_car_acceleration_motion(t, p, motion);
    return motion[2];
}

static int sign(R x)
{
    return (x > K(0.0)) - (x < K(0.0));
}

/* Put a time in its place; two that lie within rounding are one. */
static int insert(R *times, int room, int count, R t, R apart)
{
    int place = count < room ? count : room;
    for (int k = 0; k < place; k++)
        if (M(fabs)(times[k] - t) <= apart)
            return count;
    if (count >= room)
        return count + 1;
    for (; place > 0 && times[place - 1] > t; place--)
        times[place] = times[place - 1];
    times[place] = t;
    return count + 1;
}

int half_car_acceleration_breakpoints(const R *p, R duration, R *times, int room)
{
    R before[SWITCHES], after[SWITCHES], middle[SWITCHES], motion[4];
    const R margin = (ROUNDING < K(1e-10) ? K(1e-12) : K(1e-6)) * duration;
    int count = 0;
    half_car_acceleration_motion(K(0.0), p, motion);
    R begin = K(0.0), from = HALF_CAR_ACCELERATION_DISTANCE ? motion[3] : motion[2];
    half_car_acceleration_switches(begin, from, p, before);
    for (int cell = 1; cell <= CELLS; cell++) {
        const R end = duration * (R)cell / K(CELLS);
        const R to = distance(p, begin, from, end);
        half_car_acceleration_switches(end, to, p, after);
        for (int k = 0; k < SWITCHES; k++) {
            R low = begin, high = end;
            if (sign(before[k]) == sign(after[k]))
                continue;
            for (int halving = 0; halving < 60; halving++) {
                const R between = (low + high) / K(2.0);
                half_car_acceleration_switches(between, distance(p, begin, from, between), p, middle);
                if (sign(middle[k]) == sign(before[k]))
                    low = between;
                else
                    high = between;
            }
            if (high > margin && high < duration - margin)
                count = insert(times, room, count, high, margin);
        }
        begin = end;
        from = to;
        for (int k = 0; k < SWITCHES; k++)
            before[k] = after[k];
    }
    return count;
}
#else
int half_car_acceleration_breakpoints(const R *p, R duration, R *times, int room)
{
    (void)p;
    (void)duration;
    (void)times;
    (void)room;
    return 0;
}
#endif
