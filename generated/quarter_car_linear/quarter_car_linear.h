/*
 * Linear quarter car on an ISO 8608 road
 *
 * Mean and covariance of the states of a random vibration model (CADET), as C99. Written by cadet-sym 0.1.0
 * (CasADi 3.8.2); do not edit, export again.
 *
 * The moments y are packed: means of the states, then the lower triangle of their covariance column by column
 * (use quarter_car_linear_covariance), then what is integrated alongside. No function allocates memory or keeps any state; results
 * must not overlap arguments. Compile with -DQUARTER_CAR_LINEAR_FLOAT for single precision.
 */
#ifndef QUARTER_CAR_LINEAR_H
#define QUARTER_CAR_LINEAR_H

#ifdef __cplusplus
extern "C" {
#define QUARTER_CAR_LINEAR_RESTRICT
#else
#define QUARTER_CAR_LINEAR_RESTRICT restrict
#endif

#ifdef QUARTER_CAR_LINEAR_FLOAT
typedef float quarter_car_linear_real;
#else
typedef double quarter_car_linear_real;
#endif

enum {
    QUARTER_CAR_LINEAR_STATES = 5,
    QUARTER_CAR_LINEAR_PARAMETERS = 7,
    QUARTER_CAR_LINEAR_OUTPUTS = 4,
    QUARTER_CAR_LINEAR_MOMENTS = 20, /* means and covariances */
    QUARTER_CAR_LINEAR_SIZE = 20, /* of y: the moments */
    QUARTER_CAR_LINEAR_NONZEROS = 59, /* of the Jacobian */
    QUARTER_CAR_LINEAR_SWITCHES = 0 /* functions of t and s whose sign changes at a breakpoint */
};

/* Operations of one evaluation; they do not depend on the data.
 * rate: 48 additions, 14 divisions, 51 multiplications
 * jacobian: 31 additions, 14 divisions
 * outputs: 10 additions, 3 divisions, 18 multiplications
 */
enum {
    QUARTER_CAR_LINEAR_RATE_OPERATIONS = 113,
    QUARTER_CAR_LINEAR_OUTPUT_OPERATIONS = 31
};

enum { /* states */
    QUARTER_CAR_LINEAR_STATE_d = 0, /* d */
    QUARTER_CAR_LINEAR_STATE_e = 1, /* e */
    QUARTER_CAR_LINEAR_STATE_v_s = 2, /* v_s */
    QUARTER_CAR_LINEAR_STATE_v_u = 3, /* v_u */
    QUARTER_CAR_LINEAR_STATE_h_height = 4 /* h.height */
};
enum { /* parameters */
    QUARTER_CAR_LINEAR_PARAMETER_m_s = 0, /* m_s, sprung mass, kg */
    QUARTER_CAR_LINEAR_PARAMETER_m_u = 1, /* m_u, unsprung mass, kg */
    QUARTER_CAR_LINEAR_PARAMETER_k_s = 2, /* k_s, suspension stiffness, N/m */
    QUARTER_CAR_LINEAR_PARAMETER_c_s = 3, /* c_s, suspension damping, N*s/m */
    QUARTER_CAR_LINEAR_PARAMETER_k_t = 4, /* k_t, tyre stiffness, N/m */
    QUARTER_CAR_LINEAR_PARAMETER_G_d = 5, /* G_d, roughness of class C at 0.1 cycle/m, m^3 */
    QUARTER_CAR_LINEAR_PARAMETER_V = 6 /* V, speed, m/s */
};
enum { /* outputs */
    QUARTER_CAR_LINEAR_OUTPUT_stroke = 0, /* stroke */
    QUARTER_CAR_LINEAR_OUTPUT_tyre_deflection = 1, /* tyre_deflection */
    QUARTER_CAR_LINEAR_OUTPUT_body_acceleration = 2, /* body_acceleration */
    QUARTER_CAR_LINEAR_OUTPUT_dynamic_tyre_force = 3 /* dynamic_tyre_force */
};
extern const char *const quarter_car_linear_model;
extern const char *const quarter_car_linear_state_names[];
extern const char *const quarter_car_linear_parameter_names[];
extern const char *const quarter_car_linear_output_names[];
extern const quarter_car_linear_real quarter_car_linear_default_parameters[];
extern const quarter_car_linear_real quarter_car_linear_duration;   /* of the model's own run */
extern const int quarter_car_linear_points;          /* output times of that run, both ends */
extern const quarter_car_linear_real quarter_car_linear_start_speed; /* V(0) at the default parameters */

/* Index into y of the covariance of two states. */
int quarter_car_linear_covariance(int i, int j);

/* dy/dt. */
void quarter_car_linear_rate(quarter_car_linear_real t, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT y, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT p, quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT dy);

/* d(dy/dt)/dy: the QUARTER_CAR_LINEAR_NONZEROS values, column by column; entry k stands in row quarter_car_linear_jacobian_row[k], and column j
 * holds the entries from quarter_car_linear_jacobian_column[j] up to, without, quarter_car_linear_jacobian_column[j + 1]. */
void quarter_car_linear_jacobian(quarter_car_linear_real t, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT y, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT p,
                  quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT values);
extern const int quarter_car_linear_jacobian_column[];
extern const int quarter_car_linear_jacobian_row[];

/* The same as a full matrix, QUARTER_CAR_LINEAR_SIZE by QUARTER_CAR_LINEAR_SIZE, column by column. */
void quarter_car_linear_jacobian_dense(quarter_car_linear_real t, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT y, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT p,
                        quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT matrix);

/* d(dy/dt)/dt. */
void quarter_car_linear_slope(quarter_car_linear_real t, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT y, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT p,
               quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT slope);

/* Means and variances of the outputs. */
void quarter_car_linear_outputs(quarter_car_linear_real t, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT y, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT p,
                 quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT mean, quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT variance);

/* Speed, its rate, the distance (0 where it is integrated in y), the distance at the start. */
void quarter_car_linear_motion(quarter_car_linear_real t, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT p, quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT motion);

/* y at t = 0. */
void quarter_car_linear_initial(const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT p, quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT y);

/* Breakpoints of a run: times at which an input changes abruptly and the integration must start anew, increasing.
 * Writes at most `room` of them and returns how many there are. */
int quarter_car_linear_breakpoints(const quarter_car_linear_real *p, quarter_car_linear_real duration, quarter_car_linear_real *times, int room);

/* ---- How a call ended ------------------------------------------------------------------------------------ */

typedef enum {
    QUARTER_CAR_LINEAR_OK = 0,
    QUARTER_CAR_LINEAR_TOO_MANY_STEPS, /* the explicit method on a stiff problem, or a tolerance that is too tight */
    QUARTER_CAR_LINEAR_STEP_TOO_SMALL, /* the moments grow without bound, or the tolerance is below rounding */
    QUARTER_CAR_LINEAR_NOT_FINITE,     /* a rate is not a number: check the parameters and the start */
    QUARTER_CAR_LINEAR_SINGULAR,       /* a linear system has no solution: states, or a combination of them, drift without bound */
    QUARTER_CAR_LINEAR_NO_CONVERGENCE, /* no stationary moments were found from this start */
    QUARTER_CAR_LINEAR_NOT_SEMIDEFINITE /* what was found is not a covariance */
} quarter_car_linear_status;

const char *quarter_car_linear_status_text(quarter_car_linear_status status);

/* ---- Propagation ----------------------------------------------------------------------------------------- */

/* A linear system with the Jacobian, decomposed. */
typedef struct {
    quarter_car_linear_real matrix[QUARTER_CAR_LINEAR_SIZE * QUARTER_CAR_LINEAR_SIZE];
    int pivots[QUARTER_CAR_LINEAR_SIZE];
} quarter_car_linear_factors;

/* Working memory of the stiff method; of no interest otherwise. */
typedef struct {
    quarter_car_linear_real values[QUARTER_CAR_LINEAR_NONZEROS > 0 ? QUARTER_CAR_LINEAR_NONZEROS : 1];
    quarter_car_linear_real stages[6][QUARTER_CAR_LINEAR_SIZE];
    quarter_car_linear_real slope[QUARTER_CAR_LINEAR_SIZE];
    quarter_car_linear_real diagonal[QUARTER_CAR_LINEAR_SIZE];
    quarter_car_linear_factors factors;
} quarter_car_linear_stiff;

/* A run in progress. Set up with quarter_car_linear_begin; the fields up to the blank line may then be changed. */
typedef struct {
    quarter_car_linear_real rtol;         /* relative error of a step (default 1e-6) */
    quarter_car_linear_real floor;        /* what counts as zero, over a moment's own size (default 1e-4) */
    quarter_car_linear_real longest_step; /* default: no bound */
    long most_steps;       /* of one call (default 1000000) */
    quarter_car_linear_stiff *stiff;      /* 0: explicit (Dormand & Prince 5(4)); else Rosenbrock (Rodas 4(3)), with this memory */
    const quarter_car_linear_real *breakpoints; /* increasing; 0: none */
    int breakpoint_count;

    quarter_car_linear_real t;
    quarter_car_linear_real y[QUARTER_CAR_LINEAR_SIZE];
    quarter_car_linear_real step; /* to be tried next */
    long steps, refused, rates;
    quarter_car_linear_real size[QUARTER_CAR_LINEAR_SIZE];
    quarter_car_linear_real stages[7][QUARTER_CAR_LINEAR_SIZE];
    quarter_car_linear_real trial[QUARTER_CAR_LINEAR_SIZE];
    int settled; /* moments of the ground's filters that stay as they are */
    int fresh; /* stages[0] holds the rate at (t, y) */
} quarter_car_linear_run;

void quarter_car_linear_begin(quarter_car_linear_run *run, quarter_car_linear_real t, const quarter_car_linear_real *y);

/* Integrate to a later time. On failure `run` holds what was reached. */
quarter_car_linear_status quarter_car_linear_propagate(quarter_car_linear_run *run, const quarter_car_linear_real *p, quarter_car_linear_real until);

/* Fixed steps for real time: one step of the classical Runge-Kutta method, 4 rates. `work` has room for
 * 5 * QUARTER_CAR_LINEAR_SIZE values. The cost is the same for all data: QUARTER_CAR_LINEAR_STEP_OPERATIONS operations. */
void quarter_car_linear_fixed_step(quarter_car_linear_real t, quarter_car_linear_real step, quarter_car_linear_real *y, const quarter_car_linear_real *p, quarter_car_linear_real *work);
enum { QUARTER_CAR_LINEAR_STEP_OPERATIONS = 4 * QUARTER_CAR_LINEAR_RATE_OPERATIONS + 13 * QUARTER_CAR_LINEAR_SIZE + 4 };

/* ---- Stationary moments ---------------------------------------------------------------------------------- */

typedef struct {
    quarter_car_linear_real values[QUARTER_CAR_LINEAR_NONZEROS > 0 ? QUARTER_CAR_LINEAR_NONZEROS : 1];
    quarter_car_linear_real second[QUARTER_CAR_LINEAR_SIZE * QUARTER_CAR_LINEAR_SIZE];
    quarter_car_linear_real third[QUARTER_CAR_LINEAR_SIZE * QUARTER_CAR_LINEAR_SIZE];
    quarter_car_linear_real vectors[11][QUARTER_CAR_LINEAR_SIZE];
    quarter_car_linear_factors factors;
    int left_out[QUARTER_CAR_LINEAR_SIZE];
} quarter_car_linear_stationary_work;

typedef struct {
    quarter_car_linear_real speed;    /* held constant; of no meaning without ground */
    quarter_car_linear_real t, s;     /* instant and place at which explicit dependence is frozen (default 0) */
    int most_steps;    /* of each method (default 200) */
    quarter_car_linear_real residual; /* of the moment equations over the size of their own terms */
    int steps;
    int stable;        /* as a fixed point of the moment equations */
    int drifting[QUARTER_CAR_LINEAR_STATES]; /* 1: the state has no stationary moments, and nothing depends on it; its moments are NaN */
    quarter_car_linear_stationary_work *work;
} quarter_car_linear_stationary_problem;

void quarter_car_linear_stationary_begin(quarter_car_linear_stationary_problem *problem, quarter_car_linear_real speed, quarter_car_linear_stationary_work *work);

/* 1: rates depend on t or s, so that nothing is stationary but with both frozen. */
enum { QUARTER_CAR_LINEAR_EXPLICIT = 0 };

/* Stationary moments near y (Newton, then pseudo-transient continuation); with all of y zero, from next to none. */
quarter_car_linear_status quarter_car_linear_stationary(quarter_car_linear_stationary_problem *problem, const quarter_car_linear_real *p, quarter_car_linear_real *y);

/* y at t = 0, stationary where the model starts so (`work` is needed then only; 0 else). */
enum { QUARTER_CAR_LINEAR_STEADY_START = 0 };
quarter_car_linear_status quarter_car_linear_start(const quarter_car_linear_real *p, quarter_car_linear_stationary_work *work, quarter_car_linear_real *y);

/* The rate, its Jacobian (pattern as above) and the outputs at a speed held constant. */
void quarter_car_linear_held_rate(quarter_car_linear_real t, quarter_car_linear_real s, quarter_car_linear_real V, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT y,
                   const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT p, quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT dy);
void quarter_car_linear_held_jacobian(quarter_car_linear_real t, quarter_car_linear_real s, quarter_car_linear_real V, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT y,
                       const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT p, quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT values);
void quarter_car_linear_held_outputs(quarter_car_linear_real t, quarter_car_linear_real s, quarter_car_linear_real V, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT y,
                      const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT p, quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT mean,
                      quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT variance);

/* ---- Parts of the above ---------------------------------------------------------------------------------- */

/* Functions of t and s whose sign changes at a breakpoint. */
void quarter_car_linear_switches(quarter_car_linear_real t, quarter_car_linear_real s, const quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT p, quarter_car_linear_real *QUARTER_CAR_LINEAR_RESTRICT values);
/* 1 if the distance is integrated in y, at index QUARTER_CAR_LINEAR_MOMENTS; else it is known in closed form. */
enum { QUARTER_CAR_LINEAR_DISTANCE = 0 };

/* LU decomposition with pivoting, in place, of a full matrix (column by column); 0 if it is singular. */
int quarter_car_linear_decompose(int n, quarter_car_linear_real *matrix, int *pivots);
void quarter_car_linear_solve(int n, const quarter_car_linear_real *matrix, const int *pivots, quarter_car_linear_real *x);
/* factor * Jacobian + a diagonal matrix, decomposed; 0 if it is singular. x becomes the solution for x. */
int quarter_car_linear_factorise(const quarter_car_linear_real *values, quarter_car_linear_real factor, const quarter_car_linear_real *diagonal, quarter_car_linear_factors *factors);
void quarter_car_linear_backsolve(const quarter_car_linear_factors *factors, quarter_car_linear_real *x);
/* Add factor * Jacobian to a full matrix. */
void quarter_car_linear_add_jacobian(const quarter_car_linear_real *values, quarter_car_linear_real factor, quarter_car_linear_real *matrix);

#ifdef __cplusplus
}
#endif
#endif
