/* The moments at the start: standing on stationary ground, or on ground that is smooth behind the start. */
#include "van_der_pol_real.h"
void van_der_pol_start_parts(const R *restrict p, R *restrict parts);

enum {
    SIZE = VAN_DER_POL_SIZE, STATES = VAN_DER_POL_STATES, VEHICLE = 2, GROUND = 0, TRACKS = 0, MOST = 1
};


static const R profile[STATES] = {
    K(0.0), K(0.0)
};

#if 0 > 0
/* P of C P + P C' + forcing = 0: r^2 equations. Matrices are column by column here. */
static void lyapunov(int r, const R *C, const R *forcing, R *P)
{
    R matrix[MOST * MOST];
    int pivots[MOST];
    for (int i = 0; i < r * r * r * r; i++)
        matrix[i] = K(0.0);
    for (int j = 0; j < r; j++)
        for (int i = 0; i < r; i++) {
            P[j * r + i] = -forcing[j * r + i];
            for (int k = 0; k < r; k++) {
                matrix[(j * r + k) * r * r + j * r + i] += C[k * r + i];
                matrix[(k * r + i) * r * r + j * r + i] += C[k * r + j];
            }
        }
    van_der_pol_decompose(r * r, matrix, pivots);
    van_der_pol_solve(r * r, matrix, pivots, P);
    for (int j = 0; j < r; j++)
        for (int i = 0; i < j; i++)
            P[j * r + i] = P[i * r + j] = (P[j * r + i] + P[i * r + j]) / K(2.0);
}

static void multiply(int rows, int inner, int columns, const R *a, const R *b, R *product)
{
    for (int j = 0; j < columns; j++)
        for (int i = 0; i < rows; i++) {
            R sum = K(0.0);
            for (int k = 0; k < inner; k++)
                sum += a[k * rows + i] * b[j * inner + k];
            product[j * rows + i] = sum;
        }
}
#endif

#if 0 > 0
/* G behind the wheels of a gap: what each filter copy has met, and what the vehicle carries of it. */
static void behind(const van_der_pol_gap *gap, R length, const R *parts, const R *map, int copy, R *tail, R *y)
{
    const int r = copies[copy].states;
    R values[VAN_DER_POL_LONGEST];
    for (int q = 0; q < gap->columns; q++) {
        van_der_pol_collocate(gap, r, parts + copies[copy].parts, length / (R)gap->elements, tail + q * r, values);
        for (int j = 0; j < gap->elements * gap->modes; j++)
            for (int i = 0; i < r; i++) {
                const int state = copies[copy].first + i, place = van_der_pol_ground_place(gap, j, q, VEHICLE + state);
                if (place >= 0)
                    y[place] = values[j * r + i];
                for (int k = 0; !0 && k < VEHICLE; k++)
                    y[van_der_pol_ground_place(gap, j, q, k)] += map[state * VEHICLE + k] * values[j * r + i];
            }
    }
}

#if 0
/* Nothing is read before the gates open: any smooth data will do, those of steady travel do best. */
static void ahead(const van_der_pol_gap *gap, R length, const R *N, R V, R *tails, const R *entering, R *y)
{
    R values[VAN_DER_POL_LONGEST];
    for (int q = 0; q < gap->columns; q++) {
        R *tail = tails + q * STATES;
        for (int i = 0; i < STATES; i++)
            tail[i] += entering[q * STATES + i];
        if (V > K(1e-9))
            van_der_pol_collocate(gap, STATES, N, length / (R)gap->elements / V, tail, values);
        for (int j = 0; j < gap->elements * gap->modes; j++)
            for (int i = 0; i < VAN_DER_POL_ROWS; i++) {
                const R level = (j + 1) % gap->modes < 2 ? tail[i] : K(0.0);
                y[van_der_pol_ground_place(gap, j, q, i)] = V > K(1e-9) ? values[j * STATES + i] : level;
            }
    }
}
#endif

static void between(const R *parts, const R *map, R *y)
{
    const van_der_pol_gap *gap = van_der_pol_gaps;
    R tails[COPIES * WIDEST];
    for (int i = HEAD; i < SIZE; i++)
        y[i] = K(0.0);
#if 0
    const R *N = parts + LAST_PART, V = N[STATES * STATES], *entering = N + STATES * STATES + 1;
    R joined[WIDEST];
#endif
    for (int track = 0; track < TRACKS; track++) {
        for (int i = 0; i < COPIES * WIDEST; i++)
            tails[i] = K(0.0);
#if 0
        for (int i = 0; i < WIDEST; i++)
            joined[i] = K(0.0);
#endif
        for (int k = 0; k + 1 < tracks[track].count; k++, gap++) {
            const R length = parts[tracks[track].distances + k];
            const int here = tracks[track].members[k], r = copies[here].states;
            for (int i = 0; i < r * gap->columns; i++)
                tails[k * WIDEST + i] = parts[copies[here].parts + 2 * r * r + i];
            for (int c = 0; c <= k; c++)
                behind(gap, length, parts, map, tracks[track].members[c], tails + c * WIDEST, y);
#if 0
            ahead(gap, length, N, V, joined, entering, y);
            entering += STATES * gap->columns;
#endif
        }
    }
}
#endif

void van_der_pol_initial(const R *restrict p, R *restrict y)
{
    R parts[6];
    const R *offset = parts, *delta = parts + VEHICLE + VEHICLE * GROUND;
    van_der_pol_start_parts(p, parts);
    for (int i = 0; i < STATES; i++)
        y[i] = profile[i] + (i < VEHICLE ? offset[i] : K(0.0));
    for (int j = 0, k = STATES; j < STATES; j++)
        for (int i = j; i < STATES; i++, k++)
            y[k] = i < VEHICLE ? delta[j * VEHICLE + i] : K(0.0);
#if 0 > 0
    const R *map = parts + VEHICLE;
    R P[GROUND * GROUND], cross[VEHICLE * GROUND + 1], motion[4];
    for (int i = 0; i < GROUND * GROUND; i++)
        P[i] = K(0.0);
    for (int track = 0; track < (0 ? 0 : TRACKS); track++)
        for (int b = 0; b < tracks[track].count; b++) {
            const int copy = tracks[track].members[b], r = copies[copy].states, column = copies[copy].first;
            R own[MOST * MOST];
            lyapunov(r, parts + copies[copy].parts, parts + copies[copy].parts + r * r, own);
            for (int i = 0; i < r * r; i++)
                P[(column + i / r) * GROUND + column + i % r] = own[i];
#if 0 > 0
            /* what a wheel in front has met is what this one meets, and what came between them */
            for (int a = b - 1; a >= 0; a--) {
                const int row = copies[tracks[track].members[a]].first;
                van_der_pol_carry(r, parts + copies[copy].parts, parts[tracks[track].distances + a], r, own);
                for (int i = 0; i < r * r; i++)
                    P[(column + i / r) * GROUND + row + i % r] = P[(row + i % r) * GROUND + column + i / r] = own[i];
            }
#endif
        }
    multiply(VEHICLE, GROUND, GROUND, map, P, cross);
    for (int j = 0, k = STATES; j < STATES; j++)
        for (int i = j; i < STATES; i++, k++) {
            if (j >= VEHICLE)
                y[k] = P[(j - VEHICLE) * GROUND + i - VEHICLE];
            else if (i >= VEHICLE)
                y[k] = cross[(i - VEHICLE) * VEHICLE + j];
            else
                for (int m = 0; m < GROUND; m++)
                    y[k] += cross[m * VEHICLE + i] * map[m * VEHICLE + j];
        }
    van_der_pol_motion(K(0.0), p, motion);
    if (VAN_DER_POL_DISTANCE)
        y[VAN_DER_POL_MOMENTS] = motion[3];
#endif
#if 0 > 0
    between(parts, map, y);
#endif
}
