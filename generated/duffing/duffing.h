/*
 * Duffing oscillator under white noise
 *
 * Mean and covariance of the states of a random vibration model (CADET), as C99. Written by cadet-sym 0.1.0
 * (CasADi 3.8.2); do not edit, export again.
 *
 * The moments y are packed: means of the states, then the lower triangle of their covariance column by column
 * (use duffing_covariance), then what is integrated alongside. No function allocates memory or keeps any state; results
 * must not overlap arguments. Compile with -DDUFFING_FLOAT for single precision.
 */
#ifndef DUFFING_H
#define DUFFING_H

#ifdef __cplusplus
extern "C" {
#define DUFFING_RESTRICT
#else
#define DUFFING_RESTRICT restrict
#endif

#ifdef DUFFING_FLOAT
typedef float duffing_real;
#else
typedef double duffing_real;
#endif

enum {
    DUFFING_STATES = 2,
    DUFFING_PARAMETERS = 4,
    DUFFING_OUTPUTS = 1,
    DUFFING_MOMENTS = 5, /* means and covariances */
    DUFFING_SIZE = 5, /* of y: the moments */
    DUFFING_NONZEROS = 13, /* of the Jacobian */
    DUFFING_SWITCHES = 0 /* functions of t and s whose sign changes at a breakpoint */
};

/* Operations of one evaluation; they do not depend on the data.
 * rate: 13 additions, 4 comparisons, 21 multiplications
 * jacobian: 20 additions, 7 comparisons, 26 multiplications
 * outputs: 57 additions, 30 comparisons, 97 multiplications
 */
enum {
    DUFFING_RATE_OPERATIONS = 38,
    DUFFING_OUTPUT_OPERATIONS = 184
};

enum { /* states */
    DUFFING_STATE_x = 0, /* x */
    DUFFING_STATE_v = 1 /* v */
};
enum { /* parameters */
    DUFFING_PARAMETER_omega_n = 0, /* omega_n, undamped natural frequency for small motion, rad/s */
    DUFFING_PARAMETER_zeta = 1, /* zeta, damping ratio, 1 */
    DUFFING_PARAMETER_epsilon = 2, /* epsilon, cubic stiffness over linear stiffness, 1/m^2 */
    DUFFING_PARAMETER_Q = 3 /* Q, two-sided intensity of the acceleration noise, m^2/s^3 */
};
enum { /* outputs */
    DUFFING_OUTPUT_energy = 0 /* energy */
};
extern const char *const duffing_model;
extern const char *const duffing_state_names[];
extern const char *const duffing_parameter_names[];
extern const char *const duffing_output_names[];
extern const duffing_real duffing_default_parameters[];
extern const duffing_real duffing_duration;   /* of the model's own run */
extern const int duffing_points;          /* output times of that run, both ends */
extern const duffing_real duffing_start_speed; /* V(0) at the default parameters */

/* Index into y of the covariance of two states. */
int duffing_covariance(int i, int j);

/* dy/dt. */
void duffing_rate(duffing_real t, const duffing_real *DUFFING_RESTRICT y, const duffing_real *DUFFING_RESTRICT p, duffing_real *DUFFING_RESTRICT dy);

/* d(dy/dt)/dy: the DUFFING_NONZEROS values, column by column; entry k stands in row duffing_jacobian_row[k], and column j
 * holds the entries from duffing_jacobian_column[j] up to, without, duffing_jacobian_column[j + 1]. */
void duffing_jacobian(duffing_real t, const duffing_real *DUFFING_RESTRICT y, const duffing_real *DUFFING_RESTRICT p,
                  duffing_real *DUFFING_RESTRICT values);
extern const int duffing_jacobian_column[];
extern const int duffing_jacobian_row[];

/* The same as a full matrix, DUFFING_SIZE by DUFFING_SIZE, column by column. */
void duffing_jacobian_dense(duffing_real t, const duffing_real *DUFFING_RESTRICT y, const duffing_real *DUFFING_RESTRICT p,
                        duffing_real *DUFFING_RESTRICT matrix);

/* d(dy/dt)/dt. */
void duffing_slope(duffing_real t, const duffing_real *DUFFING_RESTRICT y, const duffing_real *DUFFING_RESTRICT p,
               duffing_real *DUFFING_RESTRICT slope);

/* Means and variances of the outputs. */
void duffing_outputs(duffing_real t, const duffing_real *DUFFING_RESTRICT y, const duffing_real *DUFFING_RESTRICT p,
                 duffing_real *DUFFING_RESTRICT mean, duffing_real *DUFFING_RESTRICT variance);

/* Speed, its rate, the distance (0 where it is integrated in y), the distance at the start. */
void duffing_motion(duffing_real t, const duffing_real *DUFFING_RESTRICT p, duffing_real *DUFFING_RESTRICT motion);

/* y at t = 0. */
void duffing_initial(const duffing_real *DUFFING_RESTRICT p, duffing_real *DUFFING_RESTRICT y);

/* Breakpoints of a run: times at which an input changes abruptly and the integration must start anew, increasing.
 * Writes at most `room` of them and returns how many there are. */
int duffing_breakpoints(const duffing_real *p, duffing_real duration, duffing_real *times, int room);

/* ---- How a call ended ------------------------------------------------------------------------------------ */

typedef enum {
    DUFFING_OK = 0,
    DUFFING_TOO_MANY_STEPS, /* the explicit method on a stiff problem, or a tolerance that is too tight */
    DUFFING_STEP_TOO_SMALL, /* the moments grow without bound, or the tolerance is below rounding */
    DUFFING_NOT_FINITE,     /* a rate is not a number: check the parameters and the start */
    DUFFING_SINGULAR,       /* a linear system has no solution: states, or a combination of them, drift without bound */
    DUFFING_NO_CONVERGENCE, /* no stationary moments were found from this start */
    DUFFING_NOT_SEMIDEFINITE /* what was found is not a covariance */
} duffing_status;

const char *duffing_status_text(duffing_status status);

/* ---- Propagation ----------------------------------------------------------------------------------------- */

/* A linear system with the Jacobian, decomposed. */
typedef struct {
    duffing_real matrix[DUFFING_SIZE * DUFFING_SIZE];
    int pivots[DUFFING_SIZE];
} duffing_factors;

/* Working memory of the stiff method; of no interest otherwise. */
typedef struct {
    duffing_real values[DUFFING_NONZEROS > 0 ? DUFFING_NONZEROS : 1];
    duffing_real stages[6][DUFFING_SIZE];
    duffing_real slope[DUFFING_SIZE];
    duffing_real diagonal[DUFFING_SIZE];
    duffing_factors factors;
} duffing_stiff;

/* A run in progress. Set up with duffing_begin; the fields up to the blank line may then be changed. */
typedef struct {
    duffing_real rtol;         /* relative error of a step (default 1e-6) */
    duffing_real floor;        /* what counts as zero, over a moment's own size (default 1e-4) */
    duffing_real longest_step; /* default: no bound */
    long most_steps;       /* of one call (default 1000000) */
    duffing_stiff *stiff;      /* 0: explicit (Dormand & Prince 5(4)); else Rosenbrock (Rodas 4(3)), with this memory */
    const duffing_real *breakpoints; /* increasing; 0: none */
    int breakpoint_count;

    duffing_real t;
    duffing_real y[DUFFING_SIZE];
    duffing_real step; /* to be tried next */
    long steps, refused, rates;
    duffing_real size[DUFFING_SIZE];
    duffing_real stages[7][DUFFING_SIZE];
    duffing_real trial[DUFFING_SIZE];
    int settled; /* moments of the ground's filters that stay as they are */
    int fresh; /* stages[0] holds the rate at (t, y) */
} duffing_run;

void duffing_begin(duffing_run *run, duffing_real t, const duffing_real *y);

/* Integrate to a later time. On failure `run` holds what was reached. */
duffing_status duffing_propagate(duffing_run *run, const duffing_real *p, duffing_real until);

/* Fixed steps for real time: one step of the classical Runge-Kutta method, 4 rates. `work` has room for
 * 5 * DUFFING_SIZE values. The cost is the same for all data: DUFFING_STEP_OPERATIONS operations. */
void duffing_fixed_step(duffing_real t, duffing_real step, duffing_real *y, const duffing_real *p, duffing_real *work);
enum { DUFFING_STEP_OPERATIONS = 4 * DUFFING_RATE_OPERATIONS + 13 * DUFFING_SIZE + 4 };

/* ---- Stationary moments ---------------------------------------------------------------------------------- */

typedef struct {
    duffing_real values[DUFFING_NONZEROS > 0 ? DUFFING_NONZEROS : 1];
    duffing_real second[DUFFING_SIZE * DUFFING_SIZE];
    duffing_real third[DUFFING_SIZE * DUFFING_SIZE];
    duffing_real vectors[11][DUFFING_SIZE];
    duffing_factors factors;
    int left_out[DUFFING_SIZE];
} duffing_stationary_work;

typedef struct {
    duffing_real speed;    /* held constant; of no meaning without ground */
    duffing_real t, s;     /* instant and place at which explicit dependence is frozen (default 0) */
    int most_steps;    /* of each method (default 200) */
    duffing_real residual; /* of the moment equations over the size of their own terms */
    int steps;
    int stable;        /* as a fixed point of the moment equations */
    int drifting[DUFFING_STATES]; /* 1: the state has no stationary moments, and nothing depends on it; its moments are NaN */
    duffing_stationary_work *work;
} duffing_stationary_problem;

void duffing_stationary_begin(duffing_stationary_problem *problem, duffing_real speed, duffing_stationary_work *work);

/* 1: rates depend on t or s, so that nothing is stationary but with both frozen. */
enum { DUFFING_EXPLICIT = 0 };

/* Stationary moments near y (Newton, then pseudo-transient continuation); with all of y zero, from next to none. */
duffing_status duffing_stationary(duffing_stationary_problem *problem, const duffing_real *p, duffing_real *y);

/* y at t = 0, stationary where the model starts so (`work` is needed then only; 0 else). */
enum { DUFFING_STEADY_START = 0 };
duffing_status duffing_start(const duffing_real *p, duffing_stationary_work *work, duffing_real *y);

/* The rate, its Jacobian (pattern as above) and the outputs at a speed held constant. */
void duffing_held_rate(duffing_real t, duffing_real s, duffing_real V, const duffing_real *DUFFING_RESTRICT y,
                   const duffing_real *DUFFING_RESTRICT p, duffing_real *DUFFING_RESTRICT dy);
void duffing_held_jacobian(duffing_real t, duffing_real s, duffing_real V, const duffing_real *DUFFING_RESTRICT y,
                       const duffing_real *DUFFING_RESTRICT p, duffing_real *DUFFING_RESTRICT values);
void duffing_held_outputs(duffing_real t, duffing_real s, duffing_real V, const duffing_real *DUFFING_RESTRICT y,
                      const duffing_real *DUFFING_RESTRICT p, duffing_real *DUFFING_RESTRICT mean,
                      duffing_real *DUFFING_RESTRICT variance);

/* ---- Parts of the above ---------------------------------------------------------------------------------- */

/* Functions of t and s whose sign changes at a breakpoint. */
void duffing_switches(duffing_real t, duffing_real s, const duffing_real *DUFFING_RESTRICT p, duffing_real *DUFFING_RESTRICT values);
/* 1 if the distance is integrated in y, at index DUFFING_MOMENTS; else it is known in closed form. */
enum { DUFFING_DISTANCE = 0 };

/* LU decomposition with pivoting, in place, of a full matrix (column by column); 0 if it is singular. */
int duffing_decompose(int n, duffing_real *matrix, int *pivots);
void duffing_solve(int n, const duffing_real *matrix, const int *pivots, duffing_real *x);
/* factor * Jacobian + a diagonal matrix, decomposed; 0 if it is singular. x becomes the solution for x. */
int duffing_factorise(const duffing_real *values, duffing_real factor, const duffing_real *diagonal, duffing_factors *factors);
void duffing_backsolve(const duffing_factors *factors, duffing_real *x);
/* Add factor * Jacobian to a full matrix. */
void duffing_add_jacobian(const duffing_real *values, duffing_real factor, duffing_real *matrix);

#ifdef __cplusplus
}
#endif
#endif
