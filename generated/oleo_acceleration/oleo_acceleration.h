/*
 * Oleo undercarriage accelerating from rest
 *
 * Mean and covariance of the states of a random vibration model (CADET), as C99. Written by cadet-sym 0.1.0
 * (CasADi 3.8.2); do not edit, export again.
 *
 * The moments y are packed: means of the states, then the lower triangle of their covariance column by column
 * (use oleo_acceleration_covariance), then what is integrated alongside. No function allocates memory or keeps any state; results
 * must not overlap arguments. Compile with -DOLEO_ACCELERATION_FLOAT for single precision.
 */
#ifndef OLEO_ACCELERATION_H
#define OLEO_ACCELERATION_H

#ifdef __cplusplus
extern "C" {
#define OLEO_ACCELERATION_RESTRICT
#else
#define OLEO_ACCELERATION_RESTRICT restrict
#endif

#ifdef OLEO_ACCELERATION_FLOAT
typedef float oleo_acceleration_real;
#else
typedef double oleo_acceleration_real;
#endif

enum {
    OLEO_ACCELERATION_STATES = 4,
    OLEO_ACCELERATION_PARAMETERS = 5,
    OLEO_ACCELERATION_OUTPUTS = 2,
    OLEO_ACCELERATION_MOMENTS = 14, /* means and covariances */
    OLEO_ACCELERATION_SIZE = 14, /* of y: the moments */
    OLEO_ACCELERATION_NONZEROS = 46, /* of the Jacobian */
    OLEO_ACCELERATION_SWITCHES = 0 /* functions of t and s whose sign changes at a breakpoint */
};

/* Operations of one evaluation; they do not depend on the data.
 * rate: 87 additions, 38 comparisons, 4 divisions, 1 function calls, 103 multiplications, 1 square roots
 * jacobian: 157 additions, 72 comparisons, 12 divisions, 1 function calls, 202 multiplications, 1 square roots
 * outputs: 99 additions, 70 comparisons, 8 divisions, 2 function calls, 94 multiplications, 2 square roots
 */
enum {
    OLEO_ACCELERATION_RATE_OPERATIONS = 234,
    OLEO_ACCELERATION_OUTPUT_OPERATIONS = 275
};

enum { /* states */
    OLEO_ACCELERATION_STATE_x = 0, /* x */
    OLEO_ACCELERATION_STATE_v = 1, /* v */
    OLEO_ACCELERATION_STATE_h_height = 2, /* h.height */
    OLEO_ACCELERATION_STATE_h_slope = 3 /* h.slope */
};
enum { /* parameters */
    OLEO_ACCELERATION_PARAMETER_omega_n = 0, /* omega_n, undamped natural frequency, rad/s */
    OLEO_ACCELERATION_PARAMETER_zeta = 1, /* zeta, damping ratio of the linear part, 1 */
    OLEO_ACCELERATION_PARAMETER_gamma = 2, /* gamma, oleo damping over mass, 1/m */
    OLEO_ACCELERATION_PARAMETER_r = 3, /* r, ratio of the oleo's two sides; 1 is symmetric, 1 */
    OLEO_ACCELERATION_PARAMETER_a = 4 /* a, acceleration, m/s^2 */
};
enum { /* outputs */
    OLEO_ACCELERATION_OUTPUT_closure = 0, /* closure */
    OLEO_ACCELERATION_OUTPUT_damper_force = 1 /* damper_force */
};
extern const char *const oleo_acceleration_model;
extern const char *const oleo_acceleration_state_names[];
extern const char *const oleo_acceleration_parameter_names[];
extern const char *const oleo_acceleration_output_names[];
extern const oleo_acceleration_real oleo_acceleration_default_parameters[];
extern const oleo_acceleration_real oleo_acceleration_duration;   /* of the model's own run */
extern const int oleo_acceleration_points;          /* output times of that run, both ends */
extern const oleo_acceleration_real oleo_acceleration_start_speed; /* V(0) at the default parameters */

/* Index into y of the covariance of two states. */
int oleo_acceleration_covariance(int i, int j);

/* dy/dt. */
void oleo_acceleration_rate(oleo_acceleration_real t, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT y, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT p, oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT dy);

/* d(dy/dt)/dy: the OLEO_ACCELERATION_NONZEROS values, column by column; entry k stands in row oleo_acceleration_jacobian_row[k], and column j
 * holds the entries from oleo_acceleration_jacobian_column[j] up to, without, oleo_acceleration_jacobian_column[j + 1]. */
void oleo_acceleration_jacobian(oleo_acceleration_real t, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT y, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT p,
                  oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT values);
extern const int oleo_acceleration_jacobian_column[];
extern const int oleo_acceleration_jacobian_row[];

/* The same as a full matrix, OLEO_ACCELERATION_SIZE by OLEO_ACCELERATION_SIZE, column by column. */
void oleo_acceleration_jacobian_dense(oleo_acceleration_real t, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT y, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT p,
                        oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT matrix);

/* d(dy/dt)/dt. */
void oleo_acceleration_slope(oleo_acceleration_real t, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT y, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT p,
               oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT slope);

/* Means and variances of the outputs. */
void oleo_acceleration_outputs(oleo_acceleration_real t, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT y, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT p,
                 oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT mean, oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT variance);

/* Speed, its rate, the distance (0 where it is integrated in y), the distance at the start. */
void oleo_acceleration_motion(oleo_acceleration_real t, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT p, oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT motion);

/* y at t = 0. */
void oleo_acceleration_initial(const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT p, oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT y);

/* Breakpoints of a run: times at which an input changes abruptly and the integration must start anew, increasing.
 * Writes at most `room` of them and returns how many there are. */
int oleo_acceleration_breakpoints(const oleo_acceleration_real *p, oleo_acceleration_real duration, oleo_acceleration_real *times, int room);

/* ---- How a call ended ------------------------------------------------------------------------------------ */

typedef enum {
    OLEO_ACCELERATION_OK = 0,
    OLEO_ACCELERATION_TOO_MANY_STEPS, /* the explicit method on a stiff problem, or a tolerance that is too tight */
    OLEO_ACCELERATION_STEP_TOO_SMALL, /* the moments grow without bound, or the tolerance is below rounding */
    OLEO_ACCELERATION_NOT_FINITE,     /* a rate is not a number: check the parameters and the start */
    OLEO_ACCELERATION_SINGULAR,       /* a linear system has no solution: states, or a combination of them, drift without bound */
    OLEO_ACCELERATION_NO_CONVERGENCE, /* no stationary moments were found from this start */
    OLEO_ACCELERATION_NOT_SEMIDEFINITE /* what was found is not a covariance */
} oleo_acceleration_status;

const char *oleo_acceleration_status_text(oleo_acceleration_status status);

/* ---- Propagation ----------------------------------------------------------------------------------------- */

/* A linear system with the Jacobian, decomposed. */
typedef struct {
    oleo_acceleration_real matrix[OLEO_ACCELERATION_SIZE * OLEO_ACCELERATION_SIZE];
    int pivots[OLEO_ACCELERATION_SIZE];
} oleo_acceleration_factors;

/* Working memory of the stiff method; of no interest otherwise. */
typedef struct {
    oleo_acceleration_real values[OLEO_ACCELERATION_NONZEROS > 0 ? OLEO_ACCELERATION_NONZEROS : 1];
    oleo_acceleration_real stages[6][OLEO_ACCELERATION_SIZE];
    oleo_acceleration_real slope[OLEO_ACCELERATION_SIZE];
    oleo_acceleration_real diagonal[OLEO_ACCELERATION_SIZE];
    oleo_acceleration_factors factors;
} oleo_acceleration_stiff;

/* A run in progress. Set up with oleo_acceleration_begin; the fields up to the blank line may then be changed. */
typedef struct {
    oleo_acceleration_real rtol;         /* relative error of a step (default 1e-6) */
    oleo_acceleration_real floor;        /* what counts as zero, over a moment's own size (default 1e-4) */
    oleo_acceleration_real longest_step; /* default: no bound */
    long most_steps;       /* of one call (default 1000000) */
    oleo_acceleration_stiff *stiff;      /* 0: explicit (Dormand & Prince 5(4)); else Rosenbrock (Rodas 4(3)), with this memory */
    const oleo_acceleration_real *breakpoints; /* increasing; 0: none */
    int breakpoint_count;

    oleo_acceleration_real t;
    oleo_acceleration_real y[OLEO_ACCELERATION_SIZE];
    oleo_acceleration_real step; /* to be tried next */
    long steps, refused, rates;
    oleo_acceleration_real size[OLEO_ACCELERATION_SIZE];
    oleo_acceleration_real stages[7][OLEO_ACCELERATION_SIZE];
    oleo_acceleration_real trial[OLEO_ACCELERATION_SIZE];
    int settled; /* moments of the ground's filters that stay as they are */
    int fresh; /* stages[0] holds the rate at (t, y) */
} oleo_acceleration_run;

void oleo_acceleration_begin(oleo_acceleration_run *run, oleo_acceleration_real t, const oleo_acceleration_real *y);

/* Integrate to a later time. On failure `run` holds what was reached. */
oleo_acceleration_status oleo_acceleration_propagate(oleo_acceleration_run *run, const oleo_acceleration_real *p, oleo_acceleration_real until);

/* Fixed steps for real time: one step of the classical Runge-Kutta method, 4 rates. `work` has room for
 * 5 * OLEO_ACCELERATION_SIZE values. The cost is the same for all data: OLEO_ACCELERATION_STEP_OPERATIONS operations. */
void oleo_acceleration_fixed_step(oleo_acceleration_real t, oleo_acceleration_real step, oleo_acceleration_real *y, const oleo_acceleration_real *p, oleo_acceleration_real *work);
enum { OLEO_ACCELERATION_STEP_OPERATIONS = 4 * OLEO_ACCELERATION_RATE_OPERATIONS + 13 * OLEO_ACCELERATION_SIZE + 4 };

/* ---- Stationary moments ---------------------------------------------------------------------------------- */

typedef struct {
    oleo_acceleration_real values[OLEO_ACCELERATION_NONZEROS > 0 ? OLEO_ACCELERATION_NONZEROS : 1];
    oleo_acceleration_real second[OLEO_ACCELERATION_SIZE * OLEO_ACCELERATION_SIZE];
    oleo_acceleration_real third[OLEO_ACCELERATION_SIZE * OLEO_ACCELERATION_SIZE];
    oleo_acceleration_real vectors[11][OLEO_ACCELERATION_SIZE];
    oleo_acceleration_factors factors;
    int left_out[OLEO_ACCELERATION_SIZE];
} oleo_acceleration_stationary_work;

typedef struct {
    oleo_acceleration_real speed;    /* held constant; of no meaning without ground */
    oleo_acceleration_real t, s;     /* instant and place at which explicit dependence is frozen (default 0) */
    int most_steps;    /* of each method (default 200) */
    oleo_acceleration_real residual; /* of the moment equations over the size of their own terms */
    int steps;
    int stable;        /* as a fixed point of the moment equations */
    int drifting[OLEO_ACCELERATION_STATES]; /* 1: the state has no stationary moments, and nothing depends on it; its moments are NaN */
    oleo_acceleration_stationary_work *work;
} oleo_acceleration_stationary_problem;

void oleo_acceleration_stationary_begin(oleo_acceleration_stationary_problem *problem, oleo_acceleration_real speed, oleo_acceleration_stationary_work *work);

/* 1: rates depend on t or s, so that nothing is stationary but with both frozen. */
enum { OLEO_ACCELERATION_EXPLICIT = 0 };

/* Stationary moments near y (Newton, then pseudo-transient continuation); with all of y zero, from next to none. */
oleo_acceleration_status oleo_acceleration_stationary(oleo_acceleration_stationary_problem *problem, const oleo_acceleration_real *p, oleo_acceleration_real *y);

/* y at t = 0, stationary where the model starts so (`work` is needed then only; 0 else). */
enum { OLEO_ACCELERATION_STEADY_START = 0 };
oleo_acceleration_status oleo_acceleration_start(const oleo_acceleration_real *p, oleo_acceleration_stationary_work *work, oleo_acceleration_real *y);

/* The rate, its Jacobian (pattern as above) and the outputs at a speed held constant. */
void oleo_acceleration_held_rate(oleo_acceleration_real t, oleo_acceleration_real s, oleo_acceleration_real V, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT y,
                   const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT p, oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT dy);
void oleo_acceleration_held_jacobian(oleo_acceleration_real t, oleo_acceleration_real s, oleo_acceleration_real V, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT y,
                       const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT p, oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT values);
void oleo_acceleration_held_outputs(oleo_acceleration_real t, oleo_acceleration_real s, oleo_acceleration_real V, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT y,
                      const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT p, oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT mean,
                      oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT variance);

/* ---- Parts of the above ---------------------------------------------------------------------------------- */

/* Functions of t and s whose sign changes at a breakpoint. */
void oleo_acceleration_switches(oleo_acceleration_real t, oleo_acceleration_real s, const oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT p, oleo_acceleration_real *OLEO_ACCELERATION_RESTRICT values);
/* 1 if the distance is integrated in y, at index OLEO_ACCELERATION_MOMENTS; else it is known in closed form. */
enum { OLEO_ACCELERATION_DISTANCE = 0 };

/* LU decomposition with pivoting, in place, of a full matrix (column by column); 0 if it is singular. */
int oleo_acceleration_decompose(int n, oleo_acceleration_real *matrix, int *pivots);
void oleo_acceleration_solve(int n, const oleo_acceleration_real *matrix, const int *pivots, oleo_acceleration_real *x);
/* factor * Jacobian + a diagonal matrix, decomposed; 0 if it is singular. x becomes the solution for x. */
int oleo_acceleration_factorise(const oleo_acceleration_real *values, oleo_acceleration_real factor, const oleo_acceleration_real *diagonal, oleo_acceleration_factors *factors);
void oleo_acceleration_backsolve(const oleo_acceleration_factors *factors, oleo_acceleration_real *x);
/* Add factor * Jacobian to a full matrix. */
void oleo_acceleration_add_jacobian(const oleo_acceleration_real *values, oleo_acceleration_real factor, oleo_acceleration_real *matrix);

#ifdef __cplusplus
}
#endif
#endif
