/*
 * Half car with quadratic dampers accelerating from rest
 *
 * Mean and covariance of the states of a random vibration model (CADET), as C99. Written by cadet-sym 0.1.0
 * (CasADi 3.8.2); do not edit, export again.
 *
 * The moments y are packed: means of the states, then the lower triangle of their covariance column by column
 * (use half_car_acceleration_covariance), then what is integrated alongside. No function allocates memory or keeps any state; results
 * must not overlap arguments. Compile with -DHALF_CAR_ACCELERATION_FLOAT for single precision.
 */
#ifndef HALF_CAR_ACCELERATION_H
#define HALF_CAR_ACCELERATION_H

#ifdef __cplusplus
extern "C" {
#define HALF_CAR_ACCELERATION_RESTRICT
#else
#define HALF_CAR_ACCELERATION_RESTRICT restrict
#endif

#ifdef HALF_CAR_ACCELERATION_FLOAT
typedef float half_car_acceleration_real;
#else
typedef double half_car_acceleration_real;
#endif

enum {
    HALF_CAR_ACCELERATION_STATES = 12,
    HALF_CAR_ACCELERATION_PARAMETERS = 14,
    HALF_CAR_ACCELERATION_OUTPUTS = 5,
    HALF_CAR_ACCELERATION_MOMENTS = 90, /* means and covariances */
    HALF_CAR_ACCELERATION_SIZE = 890, /* of y: the moments, the ground between the wheels */
    HALF_CAR_ACCELERATION_NONZEROS = 10144, /* of the Jacobian */
    HALF_CAR_ACCELERATION_SWITCHES = 0 /* functions of t and s whose sign changes at a breakpoint */
};

/* Operations of one evaluation; they do not depend on the data.
 * rate: 628 additions, 76 comparisons, 111 divisions, 2 function calls, 697 multiplications, 2 square roots
 * jacobian: 3119 additions, 632 comparisons, 554 divisions, 2 function calls, 4782 multiplications, 2 square
 *   roots
 * outputs: 1059 additions, 510 comparisons, 152 divisions, 47 function calls, 1046 multiplications, 12 square
 *   roots
 * rate, the ground between the wheels: 9536 additions and multiplications
 */
enum {
    HALF_CAR_ACCELERATION_RATE_OPERATIONS = 11052,
    HALF_CAR_ACCELERATION_OUTPUT_OPERATIONS = 2826
};

enum { /* states */
    HALF_CAR_ACCELERATION_STATE_z = 0, /* z */
    HALF_CAR_ACCELERATION_STATE_theta = 1, /* theta */
    HALF_CAR_ACCELERATION_STATE_z_1 = 2, /* z_1 */
    HALF_CAR_ACCELERATION_STATE_z_2 = 3, /* z_2 */
    HALF_CAR_ACCELERATION_STATE_w = 4, /* w */
    HALF_CAR_ACCELERATION_STATE_q = 5, /* q */
    HALF_CAR_ACCELERATION_STATE_w_1 = 6, /* w_1 */
    HALF_CAR_ACCELERATION_STATE_w_2 = 7, /* w_2 */
    HALF_CAR_ACCELERATION_STATE_h_1_height = 8, /* h_1.height */
    HALF_CAR_ACCELERATION_STATE_h_1_slope = 9, /* h_1.slope */
    HALF_CAR_ACCELERATION_STATE_h_2_height = 10, /* h_2.height */
    HALF_CAR_ACCELERATION_STATE_h_2_slope = 11 /* h_2.slope */
};
enum { /* parameters */
    HALF_CAR_ACCELERATION_PARAMETER_M = 0, /* M, body mass, kg */
    HALF_CAR_ACCELERATION_PARAMETER_J = 1, /* J, pitch inertia, kg*m^2 */
    HALF_CAR_ACCELERATION_PARAMETER_x_1 = 2, /* x_1, front axle, from the centre of mass, m */
    HALF_CAR_ACCELERATION_PARAMETER_x_2 = 3, /* x_2, rear axle, from the centre of mass, m */
    HALF_CAR_ACCELERATION_PARAMETER_k_1 = 4, /* k_1, front spring, N/m */
    HALF_CAR_ACCELERATION_PARAMETER_k_2 = 5, /* k_2, rear spring, N/m */
    HALF_CAR_ACCELERATION_PARAMETER_c = 6, /* c, linear part of the dampers, N*s/m */
    HALF_CAR_ACCELERATION_PARAMETER_gamma = 7, /* gamma, quadratic part of the dampers, N*s^2/m^2 */
    HALF_CAR_ACCELERATION_PARAMETER_r = 8, /* r, ratio of the dampers' two sides; 1 is symmetric, 1 */
    HALF_CAR_ACCELERATION_PARAMETER_m_1 = 9, /* m_1, front unsprung mass, kg */
    HALF_CAR_ACCELERATION_PARAMETER_m_2 = 10, /* m_2, rear unsprung mass, kg */
    HALF_CAR_ACCELERATION_PARAMETER_k_t = 11, /* k_t, tyres, N/m */
    HALF_CAR_ACCELERATION_PARAMETER_G_d = 12, /* G_d, roughness of class C at 0.1 cycle/m, m^3 */
    HALF_CAR_ACCELERATION_PARAMETER_a = 13 /* a, acceleration, m/s^2 */
};
enum { /* outputs */
    HALF_CAR_ACCELERATION_OUTPUT_stroke_1 = 0, /* stroke_1 */
    HALF_CAR_ACCELERATION_OUTPUT_stroke_2 = 1, /* stroke_2 */
    HALF_CAR_ACCELERATION_OUTPUT_tyre_force_1 = 2, /* tyre_force_1 */
    HALF_CAR_ACCELERATION_OUTPUT_tyre_force_2 = 3, /* tyre_force_2 */
    HALF_CAR_ACCELERATION_OUTPUT_bounce_acceleration = 4 /* bounce_acceleration */
};
extern const char *const half_car_acceleration_model;
extern const char *const half_car_acceleration_state_names[];
extern const char *const half_car_acceleration_parameter_names[];
extern const char *const half_car_acceleration_output_names[];
extern const half_car_acceleration_real half_car_acceleration_default_parameters[];
extern const half_car_acceleration_real half_car_acceleration_duration;   /* of the model's own run */
extern const int half_car_acceleration_points;          /* output times of that run, both ends */
extern const half_car_acceleration_real half_car_acceleration_start_speed; /* V(0) at the default parameters */

/* Index into y of the covariance of two states. */
int half_car_acceleration_covariance(int i, int j);

/* dy/dt. */
void half_car_acceleration_rate(half_car_acceleration_real t, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT y, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT p, half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT dy);

/* d(dy/dt)/dy: the HALF_CAR_ACCELERATION_NONZEROS values, column by column; entry k stands in row half_car_acceleration_jacobian_row[k], and column j
 * holds the entries from half_car_acceleration_jacobian_column[j] up to, without, half_car_acceleration_jacobian_column[j + 1]. */
void half_car_acceleration_jacobian(half_car_acceleration_real t, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT y, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT p,
                  half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT values);
extern const int half_car_acceleration_jacobian_column[];
extern const int half_car_acceleration_jacobian_row[];

/* The same as a full matrix, HALF_CAR_ACCELERATION_SIZE by HALF_CAR_ACCELERATION_SIZE, column by column. */
void half_car_acceleration_jacobian_dense(half_car_acceleration_real t, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT y, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT p,
                        half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT matrix);

/* d(dy/dt)/dt. */
void half_car_acceleration_slope(half_car_acceleration_real t, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT y, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT p,
               half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT slope);

/* Means and variances of the outputs. */
void half_car_acceleration_outputs(half_car_acceleration_real t, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT y, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT p,
                 half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT mean, half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT variance);

/* Speed, its rate, the distance (0 where it is integrated in y), the distance at the start. */
void half_car_acceleration_motion(half_car_acceleration_real t, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT p, half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT motion);

/* y at t = 0. */
void half_car_acceleration_initial(const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT p, half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT y);

/* Breakpoints of a run: times at which an input changes abruptly and the integration must start anew, increasing.
 * Writes at most `room` of them and returns how many there are. */
int half_car_acceleration_breakpoints(const half_car_acceleration_real *p, half_car_acceleration_real duration, half_car_acceleration_real *times, int room);

/* ---- How a call ended ------------------------------------------------------------------------------------ */

typedef enum {
    HALF_CAR_ACCELERATION_OK = 0,
    HALF_CAR_ACCELERATION_TOO_MANY_STEPS, /* the explicit method on a stiff problem, or a tolerance that is too tight */
    HALF_CAR_ACCELERATION_STEP_TOO_SMALL, /* the moments grow without bound, or the tolerance is below rounding */
    HALF_CAR_ACCELERATION_NOT_FINITE,     /* a rate is not a number: check the parameters and the start */
    HALF_CAR_ACCELERATION_SINGULAR,       /* a linear system has no solution: states, or a combination of them, drift without bound */
    HALF_CAR_ACCELERATION_NO_CONVERGENCE, /* no stationary moments were found from this start */
    HALF_CAR_ACCELERATION_NOT_SEMIDEFINITE /* what was found is not a covariance */
} half_car_acceleration_status;

const char *half_car_acceleration_status_text(half_car_acceleration_status status);

/* ---- Propagation ----------------------------------------------------------------------------------------- */

/* A linear system with the Jacobian, decomposed. */
typedef struct {
    half_car_acceleration_real values[HALF_CAR_ACCELERATION_NONZEROS];
    half_car_acceleration_real blocks[51200];
    half_car_acceleration_real head[90 * 90];
    half_car_acceleration_real across[90 * 640];
    int pivots[HALF_CAR_ACCELERATION_SIZE];
    int coupled[90];
} half_car_acceleration_factors;

/* Working memory of the stiff method; of no interest otherwise. */
typedef struct {
    half_car_acceleration_real values[HALF_CAR_ACCELERATION_NONZEROS > 0 ? HALF_CAR_ACCELERATION_NONZEROS : 1];
    half_car_acceleration_real stages[6][HALF_CAR_ACCELERATION_SIZE];
    half_car_acceleration_real slope[HALF_CAR_ACCELERATION_SIZE];
    half_car_acceleration_real diagonal[HALF_CAR_ACCELERATION_SIZE];
    half_car_acceleration_factors factors;
} half_car_acceleration_stiff;

/* A run in progress. Set up with half_car_acceleration_begin; the fields up to the blank line may then be changed. */
typedef struct {
    half_car_acceleration_real rtol;         /* relative error of a step (default 1e-6) */
    half_car_acceleration_real floor;        /* what counts as zero, over a moment's own size (default 1e-4) */
    half_car_acceleration_real longest_step; /* default: no bound */
    long most_steps;       /* of one call (default 1000000) */
    half_car_acceleration_stiff *stiff;      /* 0: explicit (Dormand & Prince 5(4)); else Rosenbrock (Rodas 4(3)), with this memory */
    const half_car_acceleration_real *breakpoints; /* increasing; 0: none */
    int breakpoint_count;

    half_car_acceleration_real t;
    half_car_acceleration_real y[HALF_CAR_ACCELERATION_SIZE];
    half_car_acceleration_real step; /* to be tried next */
    long steps, refused, rates;
    half_car_acceleration_real size[HALF_CAR_ACCELERATION_SIZE];
    half_car_acceleration_real stages[7][HALF_CAR_ACCELERATION_SIZE];
    half_car_acceleration_real trial[HALF_CAR_ACCELERATION_SIZE];
    int settled; /* moments of the ground's filters that stay as they are */
    int fresh; /* stages[0] holds the rate at (t, y) */
} half_car_acceleration_run;

void half_car_acceleration_begin(half_car_acceleration_run *run, half_car_acceleration_real t, const half_car_acceleration_real *y);

/* Integrate to a later time. On failure `run` holds what was reached. */
half_car_acceleration_status half_car_acceleration_propagate(half_car_acceleration_run *run, const half_car_acceleration_real *p, half_car_acceleration_real until);

/* Fixed steps for real time: one step of the classical Runge-Kutta method, 4 rates. `work` has room for
 * 5 * HALF_CAR_ACCELERATION_SIZE values. The cost is the same for all data: HALF_CAR_ACCELERATION_STEP_OPERATIONS operations. */
void half_car_acceleration_fixed_step(half_car_acceleration_real t, half_car_acceleration_real step, half_car_acceleration_real *y, const half_car_acceleration_real *p, half_car_acceleration_real *work);
enum { HALF_CAR_ACCELERATION_STEP_OPERATIONS = 4 * HALF_CAR_ACCELERATION_RATE_OPERATIONS + 13 * HALF_CAR_ACCELERATION_SIZE + 4 };

/* ---- Stationary moments ---------------------------------------------------------------------------------- */

typedef struct {
    half_car_acceleration_real values[HALF_CAR_ACCELERATION_NONZEROS > 0 ? HALF_CAR_ACCELERATION_NONZEROS : 1];
    half_car_acceleration_real second[HALF_CAR_ACCELERATION_STATES * HALF_CAR_ACCELERATION_STATES];
    half_car_acceleration_real third[HALF_CAR_ACCELERATION_STATES * HALF_CAR_ACCELERATION_STATES];
    half_car_acceleration_real vectors[11][HALF_CAR_ACCELERATION_SIZE];
    half_car_acceleration_factors factors;
    int left_out[HALF_CAR_ACCELERATION_SIZE];
} half_car_acceleration_stationary_work;

typedef struct {
    half_car_acceleration_real speed;    /* held constant; of no meaning without ground */
    half_car_acceleration_real t, s;     /* instant and place at which explicit dependence is frozen (default 0) */
    int most_steps;    /* of each method (default 200) */
    half_car_acceleration_real residual; /* of the moment equations over the size of their own terms */
    int steps;
    int stable;        /* as a fixed point of the moment equations */
    int drifting[HALF_CAR_ACCELERATION_STATES]; /* 1: the state has no stationary moments, and nothing depends on it; its moments are NaN */
    half_car_acceleration_stationary_work *work;
} half_car_acceleration_stationary_problem;

void half_car_acceleration_stationary_begin(half_car_acceleration_stationary_problem *problem, half_car_acceleration_real speed, half_car_acceleration_stationary_work *work);

/* 1: rates depend on t or s, so that nothing is stationary but with both frozen. */
enum { HALF_CAR_ACCELERATION_EXPLICIT = 0 };

/* Stationary moments near y (Newton, then pseudo-transient continuation); with all of y zero, from next to none. */
half_car_acceleration_status half_car_acceleration_stationary(half_car_acceleration_stationary_problem *problem, const half_car_acceleration_real *p, half_car_acceleration_real *y);

/* y at t = 0, stationary where the model starts so (`work` is needed then only; 0 else). */
enum { HALF_CAR_ACCELERATION_STEADY_START = 0 };
half_car_acceleration_status half_car_acceleration_start(const half_car_acceleration_real *p, half_car_acceleration_stationary_work *work, half_car_acceleration_real *y);

/* The rate, its Jacobian (pattern as above) and the outputs at a speed held constant. */
void half_car_acceleration_held_rate(half_car_acceleration_real t, half_car_acceleration_real s, half_car_acceleration_real V, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT y,
                   const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT p, half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT dy);
void half_car_acceleration_held_jacobian(half_car_acceleration_real t, half_car_acceleration_real s, half_car_acceleration_real V, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT y,
                       const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT p, half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT values);
void half_car_acceleration_held_outputs(half_car_acceleration_real t, half_car_acceleration_real s, half_car_acceleration_real V, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT y,
                      const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT p, half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT mean,
                      half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT variance);

/* ---- Parts of the above ---------------------------------------------------------------------------------- */

/* Functions of t and s whose sign changes at a breakpoint. */
void half_car_acceleration_switches(half_car_acceleration_real t, half_car_acceleration_real s, const half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT p, half_car_acceleration_real *HALF_CAR_ACCELERATION_RESTRICT values);
/* 1 if the distance is integrated in y, at index HALF_CAR_ACCELERATION_MOMENTS; else it is known in closed form. */
enum { HALF_CAR_ACCELERATION_DISTANCE = 0 };

/* LU decomposition with pivoting, in place, of a full matrix (column by column); 0 if it is singular. */
int half_car_acceleration_decompose(int n, half_car_acceleration_real *matrix, int *pivots);
void half_car_acceleration_solve(int n, const half_car_acceleration_real *matrix, const int *pivots, half_car_acceleration_real *x);
/* factor * Jacobian + a diagonal matrix, decomposed; 0 if it is singular. x becomes the solution for x. */
int half_car_acceleration_factorise(const half_car_acceleration_real *values, half_car_acceleration_real factor, const half_car_acceleration_real *diagonal, half_car_acceleration_factors *factors);
void half_car_acceleration_backsolve(const half_car_acceleration_factors *factors, half_car_acceleration_real *x);
/* Add factor * Jacobian to a full matrix. */
void half_car_acceleration_add_jacobian(const half_car_acceleration_real *values, half_car_acceleration_real factor, half_car_acceleration_real *matrix);

#ifdef __cplusplus
}
#endif
#endif
