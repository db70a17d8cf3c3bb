/*
 * Half car at constant speed
 *
 * Mean and covariance of the states of a random vibration model (CADET), as C99. Written by cadet-sym 0.1.0
 * (CasADi 3.8.2); do not edit, export again.
 *
 * The moments y are packed: means of the states, then the lower triangle of their covariance column by column
 * (use half_car_covariance), then what is integrated alongside. No function allocates memory or keeps any state; results
 * must not overlap arguments. Compile with -DHALF_CAR_FLOAT for single precision.
 */
#ifndef HALF_CAR_H
#define HALF_CAR_H

#ifdef __cplusplus
extern "C" {
#define HALF_CAR_RESTRICT
#else
#define HALF_CAR_RESTRICT restrict
#endif

#ifdef HALF_CAR_FLOAT
typedef float half_car_real;
#else
typedef double half_car_real;
#endif

enum {
    HALF_CAR_STATES = 12,
    HALF_CAR_PARAMETERS = 12,
    HALF_CAR_OUTPUTS = 6,
    HALF_CAR_MOMENTS = 90, /* means and covariances */
    HALF_CAR_SIZE = 250, /* of y: the moments, the ground between the wheels */
    HALF_CAR_NONZEROS = 1531, /* of the Jacobian */
    HALF_CAR_SWITCHES = 0 /* functions of t and s whose sign changes at a breakpoint */
};

/* Operations of one evaluation; they do not depend on the data.
 * rate: 485 additions, 61 divisions, 561 multiplications
 * jacobian: 195 additions, 60 divisions, 81 multiplications
 * outputs: 175 additions, 16 divisions, 191 multiplications
 * rate, the ground between the wheels: 1920 additions and multiplications
 */
enum {
    HALF_CAR_RATE_OPERATIONS = 3027,
    HALF_CAR_OUTPUT_OPERATIONS = 382
};

enum { /* states */
    HALF_CAR_STATE_z = 0, /* z */
    HALF_CAR_STATE_theta = 1, /* theta */
    HALF_CAR_STATE_z_1 = 2, /* z_1 */
    HALF_CAR_STATE_z_2 = 3, /* z_2 */
    HALF_CAR_STATE_w = 4, /* w */
    HALF_CAR_STATE_q = 5, /* q */
    HALF_CAR_STATE_w_1 = 6, /* w_1 */
    HALF_CAR_STATE_w_2 = 7, /* w_2 */
    HALF_CAR_STATE_h_1_height = 8, /* h_1.height */
    HALF_CAR_STATE_h_1_slope = 9, /* h_1.slope */
    HALF_CAR_STATE_h_2_height = 10, /* h_2.height */
    HALF_CAR_STATE_h_2_slope = 11 /* h_2.slope */
};
enum { /* parameters */
    HALF_CAR_PARAMETER_M = 0, /* M, body mass, kg */
    HALF_CAR_PARAMETER_J = 1, /* J, pitch inertia, kg*m^2 */
    HALF_CAR_PARAMETER_x_1 = 2, /* x_1, front axle, from the centre of mass, m */
    HALF_CAR_PARAMETER_x_2 = 3, /* x_2, rear axle, from the centre of mass, m */
    HALF_CAR_PARAMETER_k_1 = 4, /* k_1, front spring, N/m */
    HALF_CAR_PARAMETER_k_2 = 5, /* k_2, rear spring, N/m */
    HALF_CAR_PARAMETER_c = 6, /* c, dampers, N*s/m */
    HALF_CAR_PARAMETER_m_1 = 7, /* m_1, front unsprung mass, kg */
    HALF_CAR_PARAMETER_m_2 = 8, /* m_2, rear unsprung mass, kg */
    HALF_CAR_PARAMETER_k_t = 9, /* k_t, tyres, N/m */
    HALF_CAR_PARAMETER_G_d = 10, /* G_d, roughness of class C at 0.1 cycle/m, m^3 */
    HALF_CAR_PARAMETER_V = 11 /* V, speed, m/s */
};
enum { /* outputs */
    HALF_CAR_OUTPUT_stroke_1 = 0, /* stroke_1 */
    HALF_CAR_OUTPUT_stroke_2 = 1, /* stroke_2 */
    HALF_CAR_OUTPUT_tyre_1 = 2, /* tyre_1 */
    HALF_CAR_OUTPUT_tyre_2 = 3, /* tyre_2 */
    HALF_CAR_OUTPUT_bounce_acceleration = 4, /* bounce_acceleration */
    HALF_CAR_OUTPUT_pitch_acceleration = 5 /* pitch_acceleration */
};
extern const char *const half_car_model;
extern const char *const half_car_state_names[];
extern const char *const half_car_parameter_names[];
extern const char *const half_car_output_names[];
extern const half_car_real half_car_default_parameters[];
extern const half_car_real half_car_duration;   /* of the model's own run */
extern const int half_car_points;          /* output times of that run, both ends */
extern const half_car_real half_car_start_speed; /* V(0) at the default parameters */

/* Index into y of the covariance of two states. */
int half_car_covariance(int i, int j);

/* dy/dt. */
void half_car_rate(half_car_real t, const half_car_real *HALF_CAR_RESTRICT y, const half_car_real *HALF_CAR_RESTRICT p, half_car_real *HALF_CAR_RESTRICT dy);

/* d(dy/dt)/dy: the HALF_CAR_NONZEROS values, column by column; entry k stands in row half_car_jacobian_row[k], and column j
 * holds the entries from half_car_jacobian_column[j] up to, without, half_car_jacobian_column[j + 1]. */
void half_car_jacobian(half_car_real t, const half_car_real *HALF_CAR_RESTRICT y, const half_car_real *HALF_CAR_RESTRICT p,
                  half_car_real *HALF_CAR_RESTRICT values);
extern const int half_car_jacobian_column[];
extern const int half_car_jacobian_row[];

/* The same as a full matrix, HALF_CAR_SIZE by HALF_CAR_SIZE, column by column. */
void half_car_jacobian_dense(half_car_real t, const half_car_real *HALF_CAR_RESTRICT y, const half_car_real *HALF_CAR_RESTRICT p,
                        half_car_real *HALF_CAR_RESTRICT matrix);

/* d(dy/dt)/dt. */
void half_car_slope(half_car_real t, const half_car_real *HALF_CAR_RESTRICT y, const half_car_real *HALF_CAR_RESTRICT p,
               half_car_real *HALF_CAR_RESTRICT slope);

/* Means and variances of the outputs. */
void half_car_outputs(half_car_real t, const half_car_real *HALF_CAR_RESTRICT y, const half_car_real *HALF_CAR_RESTRICT p,
                 half_car_real *HALF_CAR_RESTRICT mean, half_car_real *HALF_CAR_RESTRICT variance);

/* Speed, its rate, the distance (0 where it is integrated in y), the distance at the start. */
void half_car_motion(half_car_real t, const half_car_real *HALF_CAR_RESTRICT p, half_car_real *HALF_CAR_RESTRICT motion);

/* y at t = 0. */
void half_car_initial(const half_car_real *HALF_CAR_RESTRICT p, half_car_real *HALF_CAR_RESTRICT y);

/* Breakpoints of a run: times at which an input changes abruptly and the integration must start anew, increasing.
 * Writes at most `room` of them and returns how many there are. */
int half_car_breakpoints(const half_car_real *p, half_car_real duration, half_car_real *times, int room);

/* ---- How a call ended ------------------------------------------------------------------------------------ */

typedef enum {
    HALF_CAR_OK = 0,
    HALF_CAR_TOO_MANY_STEPS, /* the explicit method on a stiff problem, or a tolerance that is too tight */
    HALF_CAR_STEP_TOO_SMALL, /* the moments grow without bound, or the tolerance is below rounding */
    HALF_CAR_NOT_FINITE,     /* a rate is not a number: check the parameters and the start */
    HALF_CAR_SINGULAR,       /* a linear system has no solution: states, or a combination of them, drift without bound */
    HALF_CAR_NO_CONVERGENCE, /* no stationary moments were found from this start */
    HALF_CAR_NOT_SEMIDEFINITE /* what was found is not a covariance */
} half_car_status;

const char *half_car_status_text(half_car_status status);

/* ---- Propagation ----------------------------------------------------------------------------------------- */

/* A linear system with the Jacobian, decomposed. */
typedef struct {
    half_car_real values[HALF_CAR_NONZEROS];
    half_car_real blocks[8192];
    half_car_real head[90 * 90];
    half_car_real across[90 * 128];
    int pivots[HALF_CAR_SIZE];
    int coupled[90];
} half_car_factors;

/* Working memory of the stiff method; of no interest otherwise. */
typedef struct {
    half_car_real values[HALF_CAR_NONZEROS > 0 ? HALF_CAR_NONZEROS : 1];
    half_car_real stages[6][HALF_CAR_SIZE];
    half_car_real slope[HALF_CAR_SIZE];
    half_car_real diagonal[HALF_CAR_SIZE];
    half_car_factors factors;
} half_car_stiff;

/* A run in progress. Set up with half_car_begin; the fields up to the blank line may then be changed. */
typedef struct {
    half_car_real rtol;         /* relative error of a step (default 1e-6) */
    half_car_real floor;        /* what counts as zero, over a moment's own size (default 1e-4) */
    half_car_real longest_step; /* default: no bound */
    long most_steps;       /* of one call (default 1000000) */
    half_car_stiff *stiff;      /* 0: explicit (Dormand & Prince 5(4)); else Rosenbrock (Rodas 4(3)), with this memory */
    const half_car_real *breakpoints; /* increasing; 0: none */
    int breakpoint_count;

    half_car_real t;
    half_car_real y[HALF_CAR_SIZE];
    half_car_real step; /* to be tried next */
    long steps, refused, rates;
    half_car_real size[HALF_CAR_SIZE];
    half_car_real stages[7][HALF_CAR_SIZE];
    half_car_real trial[HALF_CAR_SIZE];
    int settled; /* moments of the ground's filters that stay as they are */
    int fresh; /* stages[0] holds the rate at (t, y) */
} half_car_run;

void half_car_begin(half_car_run *run, half_car_real t, const half_car_real *y);

/* Integrate to a later time. On failure `run` holds what was reached. */
half_car_status half_car_propagate(half_car_run *run, const half_car_real *p, half_car_real until);

/* Fixed steps for real time: one step of the classical Runge-Kutta method, 4 rates. `work` has room for
 * 5 * HALF_CAR_SIZE values. The cost is the same for all data: HALF_CAR_STEP_OPERATIONS operations. */
void half_car_fixed_step(half_car_real t, half_car_real step, half_car_real *y, const half_car_real *p, half_car_real *work);
enum { HALF_CAR_STEP_OPERATIONS = 4 * HALF_CAR_RATE_OPERATIONS + 13 * HALF_CAR_SIZE + 4 };

/* ---- Stationary moments ---------------------------------------------------------------------------------- */

typedef struct {
    half_car_real values[HALF_CAR_NONZEROS > 0 ? HALF_CAR_NONZEROS : 1];
    half_car_real second[HALF_CAR_STATES * HALF_CAR_STATES];
    half_car_real third[HALF_CAR_STATES * HALF_CAR_STATES];
    half_car_real vectors[11][HALF_CAR_SIZE];
    half_car_factors factors;
    int left_out[HALF_CAR_SIZE];
} half_car_stationary_work;

typedef struct {
    half_car_real speed;    /* held constant; of no meaning without ground */
    half_car_real t, s;     /* instant and place at which explicit dependence is frozen (default 0) */
    int most_steps;    /* of each method (default 200) */
    half_car_real residual; /* of the moment equations over the size of their own terms */
    int steps;
    int stable;        /* as a fixed point of the moment equations */
    int drifting[HALF_CAR_STATES]; /* 1: the state has no stationary moments, and nothing depends on it; its moments are NaN */
    half_car_stationary_work *work;
} half_car_stationary_problem;

void half_car_stationary_begin(half_car_stationary_problem *problem, half_car_real speed, half_car_stationary_work *work);

/* 1: rates depend on t or s, so that nothing is stationary but with both frozen. */
enum { HALF_CAR_EXPLICIT = 0 };

/* Stationary moments near y (Newton, then pseudo-transient continuation); with all of y zero, from next to none. */
half_car_status half_car_stationary(half_car_stationary_problem *problem, const half_car_real *p, half_car_real *y);

/* y at t = 0, stationary where the model starts so (`work` is needed then only; 0 else). */
enum { HALF_CAR_STEADY_START = 0 };
half_car_status half_car_start(const half_car_real *p, half_car_stationary_work *work, half_car_real *y);

/* The rate, its Jacobian (pattern as above) and the outputs at a speed held constant. */
void half_car_held_rate(half_car_real t, half_car_real s, half_car_real V, const half_car_real *HALF_CAR_RESTRICT y,
                   const half_car_real *HALF_CAR_RESTRICT p, half_car_real *HALF_CAR_RESTRICT dy);
void half_car_held_jacobian(half_car_real t, half_car_real s, half_car_real V, const half_car_real *HALF_CAR_RESTRICT y,
                       const half_car_real *HALF_CAR_RESTRICT p, half_car_real *HALF_CAR_RESTRICT values);
void half_car_held_outputs(half_car_real t, half_car_real s, half_car_real V, const half_car_real *HALF_CAR_RESTRICT y,
                      const half_car_real *HALF_CAR_RESTRICT p, half_car_real *HALF_CAR_RESTRICT mean,
                      half_car_real *HALF_CAR_RESTRICT variance);

/* ---- Parts of the above ---------------------------------------------------------------------------------- */

/* Functions of t and s whose sign changes at a breakpoint. */
void half_car_switches(half_car_real t, half_car_real s, const half_car_real *HALF_CAR_RESTRICT p, half_car_real *HALF_CAR_RESTRICT values);
/* 1 if the distance is integrated in y, at index HALF_CAR_MOMENTS; else it is known in closed form. */
enum { HALF_CAR_DISTANCE = 0 };

/* LU decomposition with pivoting, in place, of a full matrix (column by column); 0 if it is singular. */
int half_car_decompose(int n, half_car_real *matrix, int *pivots);
void half_car_solve(int n, const half_car_real *matrix, const int *pivots, half_car_real *x);
/* factor * Jacobian + a diagonal matrix, decomposed; 0 if it is singular. x becomes the solution for x. */
int half_car_factorise(const half_car_real *values, half_car_real factor, const half_car_real *diagonal, half_car_factors *factors);
void half_car_backsolve(const half_car_factors *factors, half_car_real *x);
/* Add factor * Jacobian to a full matrix. */
void half_car_add_jacobian(const half_car_real *values, half_car_real factor, half_car_real *matrix);

#ifdef __cplusplus
}
#endif
#endif
