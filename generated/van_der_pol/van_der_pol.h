/*
 * Van der Pol oscillator under white noise
 *
 * Mean and covariance of the states of a random vibration model (CADET), as C99. Written by cadet-sym 0.1.0
 * (CasADi 3.8.2); do not edit, export again.
 *
 * The moments y are packed: means of the states, then the lower triangle of their covariance column by column
 * (use van_der_pol_covariance), then what is integrated alongside. No function allocates memory or keeps any state; results
 * must not overlap arguments. Compile with -DVAN_DER_POL_FLOAT for single precision.
 */
#ifndef VAN_DER_POL_H
#define VAN_DER_POL_H

#ifdef __cplusplus
extern "C" {
#define VAN_DER_POL_RESTRICT
#else
#define VAN_DER_POL_RESTRICT restrict
#endif

#ifdef VAN_DER_POL_FLOAT
typedef float van_der_pol_real;
#else
typedef double van_der_pol_real;
#endif

enum {
    VAN_DER_POL_STATES = 2,
    VAN_DER_POL_PARAMETERS = 2,
    VAN_DER_POL_OUTPUTS = 1,
    VAN_DER_POL_MOMENTS = 5, /* means and covariances */
    VAN_DER_POL_SIZE = 5, /* of y: the moments */
    VAN_DER_POL_NONZEROS = 16, /* of the Jacobian */
    VAN_DER_POL_SWITCHES = 0 /* functions of t and s whose sign changes at a breakpoint */
};

/* Operations of one evaluation; they do not depend on the data.
 * rate: 15 additions, 13 multiplications
 * jacobian: 32 additions, 23 multiplications
 * outputs: nothing
 */
enum {
    VAN_DER_POL_RATE_OPERATIONS = 28,
    VAN_DER_POL_OUTPUT_OPERATIONS = 0
};

enum { /* states */
    VAN_DER_POL_STATE_x = 0, /* x */
    VAN_DER_POL_STATE_v = 1 /* v */
};
enum { /* parameters */
    VAN_DER_POL_PARAMETER_mu = 0, /* mu, strength of the nonlinear damping, 1 */
    VAN_DER_POL_PARAMETER_Q = 1 /* Q, two-sided intensity of the noise, 1 */
};
enum { /* outputs */
    VAN_DER_POL_OUTPUT_displacement = 0 /* displacement */
};
extern const char *const van_der_pol_model;
extern const char *const van_der_pol_state_names[];
extern const char *const van_der_pol_parameter_names[];
extern const char *const van_der_pol_output_names[];
extern const van_der_pol_real van_der_pol_default_parameters[];
extern const van_der_pol_real van_der_pol_duration;   /* of the model's own run */
extern const int van_der_pol_points;          /* output times of that run, both ends */
extern const van_der_pol_real van_der_pol_start_speed; /* V(0) at the default parameters */

/* Index into y of the covariance of two states. */
int van_der_pol_covariance(int i, int j);

/* dy/dt. */
void van_der_pol_rate(van_der_pol_real t, const van_der_pol_real *VAN_DER_POL_RESTRICT y, const van_der_pol_real *VAN_DER_POL_RESTRICT p, van_der_pol_real *VAN_DER_POL_RESTRICT dy);

/* d(dy/dt)/dy: the VAN_DER_POL_NONZEROS values, column by column; entry k stands in row van_der_pol_jacobian_row[k], and column j
 * holds the entries from van_der_pol_jacobian_column[j] up to, without, van_der_pol_jacobian_column[j + 1]. */
void van_der_pol_jacobian(van_der_pol_real t, const van_der_pol_real *VAN_DER_POL_RESTRICT y, const van_der_pol_real *VAN_DER_POL_RESTRICT p,
                  van_der_pol_real *VAN_DER_POL_RESTRICT values);
extern const int van_der_pol_jacobian_column[];
extern const int van_der_pol_jacobian_row[];

/* The same as a full matrix, VAN_DER_POL_SIZE by VAN_DER_POL_SIZE, column by column. */
void van_der_pol_jacobian_dense(van_der_pol_real t, const van_der_pol_real *VAN_DER_POL_RESTRICT y, const van_der_pol_real *VAN_DER_POL_RESTRICT p,
                        van_der_pol_real *VAN_DER_POL_RESTRICT matrix);

/* d(dy/dt)/dt. */
void van_der_pol_slope(van_der_pol_real t, const van_der_pol_real *VAN_DER_POL_RESTRICT y, const van_der_pol_real *VAN_DER_POL_RESTRICT p,
               van_der_pol_real *VAN_DER_POL_RESTRICT slope);

/* Means and variances of the outputs. */
void van_der_pol_outputs(van_der_pol_real t, const van_der_pol_real *VAN_DER_POL_RESTRICT y, const van_der_pol_real *VAN_DER_POL_RESTRICT p,
                 van_der_pol_real *VAN_DER_POL_RESTRICT mean, van_der_pol_real *VAN_DER_POL_RESTRICT variance);

/* Speed, its rate, the distance (0 where it is integrated in y), the distance at the start. */
void van_der_pol_motion(van_der_pol_real t, const van_der_pol_real *VAN_DER_POL_RESTRICT p, van_der_pol_real *VAN_DER_POL_RESTRICT motion);

/* y at t = 0. */
void van_der_pol_initial(const van_der_pol_real *VAN_DER_POL_RESTRICT p, van_der_pol_real *VAN_DER_POL_RESTRICT y);

/* Breakpoints of a run: times at which an input changes abruptly and the integration must start anew, increasing.
 * Writes at most `room` of them and returns how many there are. */
int van_der_pol_breakpoints(const van_der_pol_real *p, van_der_pol_real duration, van_der_pol_real *times, int room);

/* ---- How a call ended ------------------------------------------------------------------------------------ */

typedef enum {
    VAN_DER_POL_OK = 0,
    VAN_DER_POL_TOO_MANY_STEPS, /* the explicit method on a stiff problem, or a tolerance that is too tight */
    VAN_DER_POL_STEP_TOO_SMALL, /* the moments grow without bound, or the tolerance is below rounding */
    VAN_DER_POL_NOT_FINITE,     /* a rate is not a number: check the parameters and the start */
    VAN_DER_POL_SINGULAR,       /* a linear system has no solution: states, or a combination of them, drift without bound */
    VAN_DER_POL_NO_CONVERGENCE, /* no stationary moments were found from this start */
    VAN_DER_POL_NOT_SEMIDEFINITE /* what was found is not a covariance */
} van_der_pol_status;

const char *van_der_pol_status_text(van_der_pol_status status);

/* ---- Propagation ----------------------------------------------------------------------------------------- */

/* A linear system with the Jacobian, decomposed. */
typedef struct {
    van_der_pol_real matrix[VAN_DER_POL_SIZE * VAN_DER_POL_SIZE];
    int pivots[VAN_DER_POL_SIZE];
} van_der_pol_factors;

/* Working memory of the stiff method; of no interest otherwise. */
typedef struct {
    van_der_pol_real values[VAN_DER_POL_NONZEROS > 0 ? VAN_DER_POL_NONZEROS : 1];
    van_der_pol_real stages[6][VAN_DER_POL_SIZE];
    van_der_pol_real slope[VAN_DER_POL_SIZE];
    van_der_pol_real diagonal[VAN_DER_POL_SIZE];
    van_der_pol_factors factors;
} van_der_pol_stiff;

/* A run in progress. Set up with van_der_pol_begin; the fields up to the blank line may then be changed. */
typedef struct {
    van_der_pol_real rtol;         /* relative error of a step (default 1e-6) */
    van_der_pol_real floor;        /* what counts as zero, over a moment's own size (default 1e-4) */
    van_der_pol_real longest_step; /* default: no bound */
    long most_steps;       /* of one call (default 1000000) */
    van_der_pol_stiff *stiff;      /* 0: explicit (Dormand & Prince 5(4)); else Rosenbrock (Rodas 4(3)), with this memory */
    const van_der_pol_real *breakpoints; /* increasing; 0: none */
    int breakpoint_count;

    van_der_pol_real t;
    van_der_pol_real y[VAN_DER_POL_SIZE];
    van_der_pol_real step; /* to be tried next */
    long steps, refused, rates;
    van_der_pol_real size[VAN_DER_POL_SIZE];
    van_der_pol_real stages[7][VAN_DER_POL_SIZE];
    van_der_pol_real trial[VAN_DER_POL_SIZE];
    int settled; /* moments of the ground's filters that stay as they are */
    int fresh; /* stages[0] holds the rate at (t, y) */
} van_der_pol_run;

void van_der_pol_begin(van_der_pol_run *run, van_der_pol_real t, const van_der_pol_real *y);

/* Integrate to a later time. On failure `run` holds what was reached. */
van_der_pol_status van_der_pol_propagate(van_der_pol_run *run, const van_der_pol_real *p, van_der_pol_real until);

/* Fixed steps for real time: one step of the classical Runge-Kutta method, 4 rates. `work` has room for
 * 5 * VAN_DER_POL_SIZE values. The cost is the same for all data: VAN_DER_POL_STEP_OPERATIONS operations. */
void van_der_pol_fixed_step(van_der_pol_real t, van_der_pol_real step, van_der_pol_real *y, const van_der_pol_real *p, van_der_pol_real *work);
enum { VAN_DER_POL_STEP_OPERATIONS = 4 * VAN_DER_POL_RATE_OPERATIONS + 13 * VAN_DER_POL_SIZE + 4 };

/* ---- Stationary moments ---------------------------------------------------------------------------------- */

typedef struct {
    van_der_pol_real values[VAN_DER_POL_NONZEROS > 0 ? VAN_DER_POL_NONZEROS : 1];
    van_der_pol_real second[VAN_DER_POL_SIZE * VAN_DER_POL_SIZE];
    van_der_pol_real third[VAN_DER_POL_SIZE * VAN_DER_POL_SIZE];
    van_der_pol_real vectors[11][VAN_DER_POL_SIZE];
    van_der_pol_factors factors;
    int left_out[VAN_DER_POL_SIZE];
} van_der_pol_stationary_work;

typedef struct {
    van_der_pol_real speed;    /* held constant; of no meaning without ground */
    van_der_pol_real t, s;     /* instant and place at which explicit dependence is frozen (default 0) */
    int most_steps;    /* of each method (default 200) */
    van_der_pol_real residual; /* of the moment equations over the size of their own terms */
    int steps;
    int stable;        /* as a fixed point of the moment equations */
    int drifting[VAN_DER_POL_STATES]; /* 1: the state has no stationary moments, and nothing depends on it; its moments are NaN */
    van_der_pol_stationary_work *work;
} van_der_pol_stationary_problem;

void van_der_pol_stationary_begin(van_der_pol_stationary_problem *problem, van_der_pol_real speed, van_der_pol_stationary_work *work);

/* 1: rates depend on t or s, so that nothing is stationary but with both frozen. */
enum { VAN_DER_POL_EXPLICIT = 0 };

/* Stationary moments near y (Newton, then pseudo-transient continuation); with all of y zero, from next to none. */
van_der_pol_status van_der_pol_stationary(van_der_pol_stationary_problem *problem, const van_der_pol_real *p, van_der_pol_real *y);

/* y at t = 0, stationary where the model starts so (`work` is needed then only; 0 else). */
enum { VAN_DER_POL_STEADY_START = 0 };
van_der_pol_status van_der_pol_start(const van_der_pol_real *p, van_der_pol_stationary_work *work, van_der_pol_real *y);

/* The rate, its Jacobian (pattern as above) and the outputs at a speed held constant. */
void van_der_pol_held_rate(van_der_pol_real t, van_der_pol_real s, van_der_pol_real V, const van_der_pol_real *VAN_DER_POL_RESTRICT y,
                   const van_der_pol_real *VAN_DER_POL_RESTRICT p, van_der_pol_real *VAN_DER_POL_RESTRICT dy);
void van_der_pol_held_jacobian(van_der_pol_real t, van_der_pol_real s, van_der_pol_real V, const van_der_pol_real *VAN_DER_POL_RESTRICT y,
                       const van_der_pol_real *VAN_DER_POL_RESTRICT p, van_der_pol_real *VAN_DER_POL_RESTRICT values);
void van_der_pol_held_outputs(van_der_pol_real t, van_der_pol_real s, van_der_pol_real V, const van_der_pol_real *VAN_DER_POL_RESTRICT y,
                      const van_der_pol_real *VAN_DER_POL_RESTRICT p, van_der_pol_real *VAN_DER_POL_RESTRICT mean,
                      van_der_pol_real *VAN_DER_POL_RESTRICT variance);

/* ---- Parts of the above ---------------------------------------------------------------------------------- */

/* Functions of t and s whose sign changes at a breakpoint. */
void van_der_pol_switches(van_der_pol_real t, van_der_pol_real s, const van_der_pol_real *VAN_DER_POL_RESTRICT p, van_der_pol_real *VAN_DER_POL_RESTRICT values);
/* 1 if the distance is integrated in y, at index VAN_DER_POL_MOMENTS; else it is known in closed form. */
enum { VAN_DER_POL_DISTANCE = 0 };

/* LU decomposition with pivoting, in place, of a full matrix (column by column); 0 if it is singular. */
int van_der_pol_decompose(int n, van_der_pol_real *matrix, int *pivots);
void van_der_pol_solve(int n, const van_der_pol_real *matrix, const int *pivots, van_der_pol_real *x);
/* factor * Jacobian + a diagonal matrix, decomposed; 0 if it is singular. x becomes the solution for x. */
int van_der_pol_factorise(const van_der_pol_real *values, van_der_pol_real factor, const van_der_pol_real *diagonal, van_der_pol_factors *factors);
void van_der_pol_backsolve(const van_der_pol_factors *factors, van_der_pol_real *x);
/* Add factor * Jacobian to a full matrix. */
void van_der_pol_add_jacobian(const van_der_pol_real *values, van_der_pol_real factor, van_der_pol_real *matrix);

#ifdef __cplusplus
}
#endif
#endif
