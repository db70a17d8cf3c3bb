/*
 * Oleo undercarriage at constant speed
 *
 * Mean and covariance of the states of a random vibration model (CADET), as C99. Written by cadet-sym 0.1.0
 * (CasADi 3.8.2); do not edit, export again.
 *
 * The moments y are packed: means of the states, then the lower triangle of their covariance column by column
 * (use oleo_constant_speed_covariance), then what is integrated alongside. No function allocates memory or keeps any state; results
 * must not overlap arguments. Compile with -DOLEO_CONSTANT_SPEED_FLOAT for single precision.
 */
#ifndef OLEO_CONSTANT_SPEED_H
#define OLEO_CONSTANT_SPEED_H

#ifdef __cplusplus
extern "C" {
#define OLEO_CONSTANT_SPEED_RESTRICT
#else
#define OLEO_CONSTANT_SPEED_RESTRICT restrict
#endif

#ifdef OLEO_CONSTANT_SPEED_FLOAT
typedef float oleo_constant_speed_real;
#else
typedef double oleo_constant_speed_real;
#endif

enum {
    OLEO_CONSTANT_SPEED_STATES = 4,
    OLEO_CONSTANT_SPEED_PARAMETERS = 5,
    OLEO_CONSTANT_SPEED_OUTPUTS = 2,
    OLEO_CONSTANT_SPEED_MOMENTS = 14, /* means and covariances */
    OLEO_CONSTANT_SPEED_SIZE = 14, /* of y: the moments */
    OLEO_CONSTANT_SPEED_NONZEROS = 46, /* of the Jacobian */
    OLEO_CONSTANT_SPEED_SWITCHES = 0 /* functions of t and s whose sign changes at a breakpoint */
};

/* Operations of one evaluation; they do not depend on the data.
 * rate: 85 additions, 38 comparisons, 4 divisions, 1 function calls, 102 multiplications, 1 square roots
 * jacobian: 154 additions, 72 comparisons, 12 divisions, 1 function calls, 202 multiplications, 1 square roots
 * outputs: 99 additions, 70 comparisons, 8 divisions, 2 function calls, 94 multiplications, 2 square roots
 */
enum {
    OLEO_CONSTANT_SPEED_RATE_OPERATIONS = 231,
    OLEO_CONSTANT_SPEED_OUTPUT_OPERATIONS = 275
};

enum { /* states */
    OLEO_CONSTANT_SPEED_STATE_x = 0, /* x */
    OLEO_CONSTANT_SPEED_STATE_v = 1, /* v */
    OLEO_CONSTANT_SPEED_STATE_h_height = 2, /* h.height */
    OLEO_CONSTANT_SPEED_STATE_h_slope = 3 /* h.slope */
};
enum { /* parameters */
    OLEO_CONSTANT_SPEED_PARAMETER_omega_n = 0, /* omega_n, undamped natural frequency, 1 */
    OLEO_CONSTANT_SPEED_PARAMETER_zeta = 1, /* zeta, damping ratio of the linear part; not printed in the paper, 1 */
    OLEO_CONSTANT_SPEED_PARAMETER_gamma = 2, /* gamma, oleo damping over mass, times sigma, 1 */
    OLEO_CONSTANT_SPEED_PARAMETER_r = 3, /* r, ratio of the oleo's two sides; 1 is symmetric, 1 */
    OLEO_CONSTANT_SPEED_PARAMETER_V = 4 /* V, speed, 1 */
};
enum { /* outputs */
    OLEO_CONSTANT_SPEED_OUTPUT_closure = 0, /* closure */
    OLEO_CONSTANT_SPEED_OUTPUT_damper_force = 1 /* damper_force */
};
extern const char *const oleo_constant_speed_model;
extern const char *const oleo_constant_speed_state_names[];
extern const char *const oleo_constant_speed_parameter_names[];
extern const char *const oleo_constant_speed_output_names[];
extern const oleo_constant_speed_real oleo_constant_speed_default_parameters[];
extern const oleo_constant_speed_real oleo_constant_speed_duration;   /* of the model's own run */
extern const int oleo_constant_speed_points;          /* output times of that run, both ends */
extern const oleo_constant_speed_real oleo_constant_speed_start_speed; /* V(0) at the default parameters */

/* Index into y of the covariance of two states. */
int oleo_constant_speed_covariance(int i, int j);

/* dy/dt. */
void oleo_constant_speed_rate(oleo_constant_speed_real t, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT y, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT p, oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT dy);

/* d(dy/dt)/dy: the OLEO_CONSTANT_SPEED_NONZEROS values, column by column; entry k stands in row oleo_constant_speed_jacobian_row[k], and column j
 * holds the entries from oleo_constant_speed_jacobian_column[j] up to, without, oleo_constant_speed_jacobian_column[j + 1]. */
void oleo_constant_speed_jacobian(oleo_constant_speed_real t, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT y, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT p,
                  oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT values);
extern const int oleo_constant_speed_jacobian_column[];
extern const int oleo_constant_speed_jacobian_row[];

/* The same as a full matrix, OLEO_CONSTANT_SPEED_SIZE by OLEO_CONSTANT_SPEED_SIZE, column by column. */
void oleo_constant_speed_jacobian_dense(oleo_constant_speed_real t, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT y, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT p,
                        oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT matrix);

/* d(dy/dt)/dt. */
void oleo_constant_speed_slope(oleo_constant_speed_real t, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT y, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT p,
               oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT slope);

/* Means and variances of the outputs. */
void oleo_constant_speed_outputs(oleo_constant_speed_real t, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT y, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT p,
                 oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT mean, oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT variance);

/* Speed, its rate, the distance (0 where it is integrated in y), the distance at the start. */
void oleo_constant_speed_motion(oleo_constant_speed_real t, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT p, oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT motion);

/* y at t = 0. */
void oleo_constant_speed_initial(const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT p, oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT y);

/* Breakpoints of a run: times at which an input changes abruptly and the integration must start anew, increasing.
 * Writes at most `room` of them and returns how many there are. */
int oleo_constant_speed_breakpoints(const oleo_constant_speed_real *p, oleo_constant_speed_real duration, oleo_constant_speed_real *times, int room);

/* ---- How a call ended ------------------------------------------------------------------------------------ */

typedef enum {
    OLEO_CONSTANT_SPEED_OK = 0,
    OLEO_CONSTANT_SPEED_TOO_MANY_STEPS, /* the explicit method on a stiff problem, or a tolerance that is too tight */
    OLEO_CONSTANT_SPEED_STEP_TOO_SMALL, /* the moments grow without bound, or the tolerance is below rounding */
    OLEO_CONSTANT_SPEED_NOT_FINITE,     /* a rate is not a number: check the parameters and the start */
    OLEO_CONSTANT_SPEED_SINGULAR,       /* a linear system has no solution: states, or a combination of them, drift without bound */
    OLEO_CONSTANT_SPEED_NO_CONVERGENCE, /* no stationary moments were found from this start */
    OLEO_CONSTANT_SPEED_NOT_SEMIDEFINITE /* what was found is not a covariance */
} oleo_constant_speed_status;

const char *oleo_constant_speed_status_text(oleo_constant_speed_status status);

/* ---- Propagation ----------------------------------------------------------------------------------------- */

/* A linear system with the Jacobian, decomposed. */
typedef struct {
    oleo_constant_speed_real matrix[OLEO_CONSTANT_SPEED_SIZE * OLEO_CONSTANT_SPEED_SIZE];
    int pivots[OLEO_CONSTANT_SPEED_SIZE];
} oleo_constant_speed_factors;

/* Working memory of the stiff method; of no interest otherwise. */
typedef struct {
    oleo_constant_speed_real values[OLEO_CONSTANT_SPEED_NONZEROS > 0 ? OLEO_CONSTANT_SPEED_NONZEROS : 1];
    oleo_constant_speed_real stages[6][OLEO_CONSTANT_SPEED_SIZE];
    oleo_constant_speed_real slope[OLEO_CONSTANT_SPEED_SIZE];
    oleo_constant_speed_real diagonal[OLEO_CONSTANT_SPEED_SIZE];
    oleo_constant_speed_factors factors;
} oleo_constant_speed_stiff;

/* A run in progress. Set up with oleo_constant_speed_begin; the fields up to the blank line may then be changed. */
typedef struct {
    oleo_constant_speed_real rtol;         /* relative error of a step (default 1e-6) */
    oleo_constant_speed_real floor;        /* what counts as zero, over a moment's own size (default 1e-4) */
    oleo_constant_speed_real longest_step; /* default: no bound */
    long most_steps;       /* of one call (default 1000000) */
    oleo_constant_speed_stiff *stiff;      /* 0: explicit (Dormand & Prince 5(4)); else Rosenbrock (Rodas 4(3)), with this memory */
    const oleo_constant_speed_real *breakpoints; /* increasing; 0: none */
    int breakpoint_count;

    oleo_constant_speed_real t;
    oleo_constant_speed_real y[OLEO_CONSTANT_SPEED_SIZE];
    oleo_constant_speed_real step; /* to be tried next */
    long steps, refused, rates;
    oleo_constant_speed_real size[OLEO_CONSTANT_SPEED_SIZE];
    oleo_constant_speed_real stages[7][OLEO_CONSTANT_SPEED_SIZE];
    oleo_constant_speed_real trial[OLEO_CONSTANT_SPEED_SIZE];
    int settled; /* moments of the ground's filters that stay as they are */
    int fresh; /* stages[0] holds the rate at (t, y) */
} oleo_constant_speed_run;

void oleo_constant_speed_begin(oleo_constant_speed_run *run, oleo_constant_speed_real t, const oleo_constant_speed_real *y);

/* Integrate to a later time. On failure `run` holds what was reached. */
oleo_constant_speed_status oleo_constant_speed_propagate(oleo_constant_speed_run *run, const oleo_constant_speed_real *p, oleo_constant_speed_real until);

/* Fixed steps for real time: one step of the classical Runge-Kutta method, 4 rates. `work` has room for
 * 5 * OLEO_CONSTANT_SPEED_SIZE values. The cost is the same for all data: OLEO_CONSTANT_SPEED_STEP_OPERATIONS operations. */
void oleo_constant_speed_fixed_step(oleo_constant_speed_real t, oleo_constant_speed_real step, oleo_constant_speed_real *y, const oleo_constant_speed_real *p, oleo_constant_speed_real *work);
enum { OLEO_CONSTANT_SPEED_STEP_OPERATIONS = 4 * OLEO_CONSTANT_SPEED_RATE_OPERATIONS + 13 * OLEO_CONSTANT_SPEED_SIZE + 4 };

/* ---- Stationary moments ---------------------------------------------------------------------------------- */

typedef struct {
    oleo_constant_speed_real values[OLEO_CONSTANT_SPEED_NONZEROS > 0 ? OLEO_CONSTANT_SPEED_NONZEROS : 1];
    oleo_constant_speed_real second[OLEO_CONSTANT_SPEED_SIZE * OLEO_CONSTANT_SPEED_SIZE];
    oleo_constant_speed_real third[OLEO_CONSTANT_SPEED_SIZE * OLEO_CONSTANT_SPEED_SIZE];
    oleo_constant_speed_real vectors[11][OLEO_CONSTANT_SPEED_SIZE];
    oleo_constant_speed_factors factors;
    int left_out[OLEO_CONSTANT_SPEED_SIZE];
} oleo_constant_speed_stationary_work;

typedef struct {
    oleo_constant_speed_real speed;    /* held constant; of no meaning without ground */
    oleo_constant_speed_real t, s;     /* instant and place at which explicit dependence is frozen (default 0) */
    int most_steps;    /* of each method (default 200) */
    oleo_constant_speed_real residual; /* of the moment equations over the size of their own terms */
    int steps;
    int stable;        /* as a fixed point of the moment equations */
    int drifting[OLEO_CONSTANT_SPEED_STATES]; /* 1: the state has no stationary moments, and nothing depends on it; its moments are NaN */
    oleo_constant_speed_stationary_work *work;
} oleo_constant_speed_stationary_problem;

void oleo_constant_speed_stationary_begin(oleo_constant_speed_stationary_problem *problem, oleo_constant_speed_real speed, oleo_constant_speed_stationary_work *work);

/* 1: rates depend on t or s, so that nothing is stationary but with both frozen. */
enum { OLEO_CONSTANT_SPEED_EXPLICIT = 0 };

/* Stationary moments near y (Newton, then pseudo-transient continuation); with all of y zero, from next to none. */
oleo_constant_speed_status oleo_constant_speed_stationary(oleo_constant_speed_stationary_problem *problem, const oleo_constant_speed_real *p, oleo_constant_speed_real *y);

/* y at t = 0, stationary where the model starts so (`work` is needed then only; 0 else). */
enum { OLEO_CONSTANT_SPEED_STEADY_START = 0 };
oleo_constant_speed_status oleo_constant_speed_start(const oleo_constant_speed_real *p, oleo_constant_speed_stationary_work *work, oleo_constant_speed_real *y);

/* The rate, its Jacobian (pattern as above) and the outputs at a speed held constant. */
void oleo_constant_speed_held_rate(oleo_constant_speed_real t, oleo_constant_speed_real s, oleo_constant_speed_real V, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT y,
                   const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT p, oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT dy);
void oleo_constant_speed_held_jacobian(oleo_constant_speed_real t, oleo_constant_speed_real s, oleo_constant_speed_real V, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT y,
                       const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT p, oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT values);
void oleo_constant_speed_held_outputs(oleo_constant_speed_real t, oleo_constant_speed_real s, oleo_constant_speed_real V, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT y,
                      const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT p, oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT mean,
                      oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT variance);

/* ---- Parts of the above ---------------------------------------------------------------------------------- */

/* Functions of t and s whose sign changes at a breakpoint. */
void oleo_constant_speed_switches(oleo_constant_speed_real t, oleo_constant_speed_real s, const oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT p, oleo_constant_speed_real *OLEO_CONSTANT_SPEED_RESTRICT values);
/* 1 if the distance is integrated in y, at index OLEO_CONSTANT_SPEED_MOMENTS; else it is known in closed form. */
enum { OLEO_CONSTANT_SPEED_DISTANCE = 0 };

/* LU decomposition with pivoting, in place, of a full matrix (column by column); 0 if it is singular. */
int oleo_constant_speed_decompose(int n, oleo_constant_speed_real *matrix, int *pivots);
void oleo_constant_speed_solve(int n, const oleo_constant_speed_real *matrix, const int *pivots, oleo_constant_speed_real *x);
/* factor * Jacobian + a diagonal matrix, decomposed; 0 if it is singular. x becomes the solution for x. */
int oleo_constant_speed_factorise(const oleo_constant_speed_real *values, oleo_constant_speed_real factor, const oleo_constant_speed_real *diagonal, oleo_constant_speed_factors *factors);
void oleo_constant_speed_backsolve(const oleo_constant_speed_factors *factors, oleo_constant_speed_real *x);
/* Add factor * Jacobian to a full matrix. */
void oleo_constant_speed_add_jacobian(const oleo_constant_speed_real *values, oleo_constant_speed_real factor, oleo_constant_speed_real *matrix);

#ifdef __cplusplus
}
#endif
#endif
