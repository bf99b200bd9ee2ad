/*
 * libdynid: the torque of an identified model, in the control loop.
 *
 * Generated from rust/dynid-c by cbindgen; change that, not this. Guide:
 * https://github.com/dynid-rs/dynid_rs/blob/main/docs/how_to/c_interface.md
 *
 * Every function that can fail returns a DynidCode and leaves one sentence in dynid_last_error(). No function
 * panics or throws across this boundary. A model is immutable and may be used by any number of threads; an
 * estimator belongs to one thread at a time. Lengths are in doubles.
 */

#ifndef DYNID_H
#define DYNID_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

/*
 The state held a NaN or an infinity, or the torque overflowed; the last good torque is repeated.
 */
#define DYNID_STATUS_NON_FINITE 1

/*
 The state is outside the box that the model was trained on.
 */
#define DYNID_STATUS_OUTSIDE_DOMAIN 2

/*
 The third loop was asked far from its data; its torque was faded out.
 */
#define DYNID_STATUS_RESIDUAL_FADED 4

/*
 An effect needs a signal that the state does not have (a temperature); its torque is zero on that joint.
 */
#define DYNID_STATUS_SIGNAL_MISSING 8

/*
 The torque channel is late, and states do not reach back far enough yet: the oldest one was evaluated.
 */
#define DYNID_STATUS_SETTLING 512

/*
 The state lies beyond the model's limits; it was evaluated at them.
 */
#define DYNID_STATUS_BEYOND_LIMITS 4096

/*
 What a call came to.
 */
typedef enum {
  /*
   Done.
   */
  DYNID_CODE_OK = 0,
  /*
   A pointer is null, or does not point to where such a value can be.
   */
  DYNID_CODE_POINTER = 1,
  /*
   A length is not the one that is needed.
   */
  DYNID_CODE_LENGTH = 2,
  /*
   A number is outside its range.
   */
  DYNID_CODE_RANGE = 3,
  /*
   The file could not be read.
   */
  DYNID_CODE_FILE = 4,
  /*
   What was read is not a model.
   */
  DYNID_CODE_MODEL = 5,
  /*
   A fault of this library; please report it. The handle may be reset or freed, and nothing was written.
   */
  DYNID_CODE_INTERNAL = 6,
} DynidCode;

/*
 Evaluates a model and remembers what its effects remember. For one thread at a time.
 */
typedef struct DynidEstimator DynidEstimator;

/*
 An identified model. Immutable: any number of threads may use it, and estimators outlive it.
 */
typedef struct DynidModel DynidModel;

/*
 One state: each pointer leads to as many doubles as there are joints.
 */
typedef struct {
  /*
   Link-side position [rad, m].
   */
  const double *q;
  /*
   Link-side velocity [rad/s, m/s].
   */
  const double *dq;
  /*
   Link-side acceleration [rad/s^2, m/s^2].
   */
  const double *ddq;
  /*
   Motor position divided by the gear ratio [rad, m]; NULL with one encoder per joint, like the next two.
   */
  const double *q_motor;
  /*
   Motor velocity divided by the gear ratio.
   */
  const double *dq_motor;
  /*
   Motor acceleration divided by the gear ratio.
   */
  const double *ddq_motor;
  /*
   Measured temperatures [degC], NaN where one is not known; NULL without.
   */
  const double *temperature;
} DynidState;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/*
 One sentence on why the last call on this thread that failed did so; empty if none has. Zero-terminated UTF-8 that
 stays until the next call on this thread fails, or the thread ends. A call that works leaves it as it is.
 */
const char *dynid_last_error(void);

/*
 Version of this library, as "0.1.0".
 */
const char *dynid_version(void);

/*
 Loads the model.json at path, a zero-terminated path (UTF-8 on Windows), into a new handle at *model; free it with
 dynid_model_free. Where it fails *model stays as it is. Allocates and reads a file: not for the control loop.

 path is a zero-terminated string; model leads to room for a pointer.
 */
DynidCode dynid_model_load(const char *path,
                           DynidModel **model);

/*
 The same from the n_bytes bytes of a model.json in memory.

 bytes leads to n_bytes bytes; model leads to room for a pointer.
 */
DynidCode dynid_model_parse(const uint8_t *bytes, size_t n_bytes, DynidModel **model);

/*
 Frees a model; NULL is nothing to free. Estimators made of it stay usable.

 model is NULL or a handle that is not freed yet and not used any more.
 */
void dynid_model_free(DynidModel *model);

/*
 Number of joints; 0 if model is NULL.

 model is NULL or a handle.
 */
size_t dynid_model_n_joints(const DynidModel *model);

/*
 Number of terms whose sum is the torque; 0 if model is NULL.

 model is NULL or a handle.
 */
size_t dynid_model_n_terms(const DynidModel *model);

/*
 Name of the robot. Like every text of a model: zero-terminated UTF-8, the model's own, gone when it is freed; NULL
 with a sentence in dynid_last_error() where there is none.

 model is NULL or a handle.
 */
const char *dynid_model_robot_name(const DynidModel *model);

/*
 Name of joint joint, counted from 0.

 model is NULL or a handle.
 */
const char *dynid_model_joint_name(const DynidModel *model, size_t joint);

/*
 Unit of the position of joint joint: "rad", or "m" where it slides.

 model is NULL or a handle.
 */
const char *dynid_model_joint_unit(const DynidModel *model, size_t joint);

/*
 Name of term term, counted from 0: "rigid_body", the effects, "residual".

 model is NULL or a handle.
 */
const char *dynid_model_term_name(const DynidModel *model, size_t term);

/*
 Unit of every torque: "N*m", or "A" where currents were identified.

 model is NULL or a handle.
 */
const char *dynid_model_torque_unit(const DynidModel *model);

/*
 Time between the states that the model was made for [s]; 0 where nothing in it depends on that.

 model is NULL or a handle.
 */
double dynid_model_step(const DynidModel *model);

/*
 How late the torque channel of joint joint is behind the encoders [s]: an estimator gives the torque of the state of
 that long ago, which is what the channel shows. Negative where the channel is early; an estimator then gives the torque
 of the state, which the channel has shown before. 0 if model is NULL or has no such joint.

 model is NULL or a handle.
 */
double dynid_model_torque_delay(const DynidModel *model,
                                size_t joint);

/*
 True if friction of joint joint follows a measured temperature.

 model is NULL or a handle.
 */
bool dynid_model_wants_temperature(const DynidModel *model, size_t joint);

/*
 True if the model was identified with an encoder on either side of the gears, so that the motor side should be given.

 model is NULL or a handle.
 */
bool dynid_model_wants_motor_side(const DynidModel *model);

/*
 A new estimator of model at *estimator; free it with dynid_estimator_free. step is the time between the states
 that will come [s], 0 for the model's own. This is the last allocation. Where it fails *estimator stays as it is.

 model is NULL or a handle; estimator leads to room for a pointer.
 */
DynidCode dynid_estimator_new(const DynidModel *model,
                              double step,
                              DynidEstimator **estimator);

/*
 A second estimator at *copy that remembers what estimator does; free it with dynid_estimator_free. Allocates.

 estimator is NULL or a handle that nobody steps meanwhile; copy leads to room for a pointer.
 */
DynidCode dynid_estimator_clone(const DynidEstimator *estimator,
                                DynidEstimator **copy);

/*
 Forgets everything, as if it were new. Allocates nothing.

 estimator is NULL or a handle that nobody else uses meanwhile.
 */
DynidCode dynid_estimator_reset(DynidEstimator *estimator);

/*
 Frees an estimator; NULL is nothing to free.

 estimator is NULL or a handle that is not freed yet and not used any more.
 */
void dynid_estimator_free(DynidEstimator *estimator);

/*
 One step: the torque of every joint at state into tau (n_joints doubles), what was unusual into *status
 (DYNID_STATUS_ bits, 0 for a good step). Call it once per cycle, in order of time: effects remember.

 tau is finite whatever comes in: a NaN, an infinity or an overflow repeats the last good torque (zeros before the
 first) and says so in the status. No allocation, no lock, no system call. Where it fails nothing is written and nothing is
 remembered. tau may be one of the arrays of state.

 estimator is NULL or a handle that nobody else uses meanwhile; state is NULL or leads to a state, whose arrays and
 tau are NULL or have n_joints doubles; status leads to room for its type.
 */
DynidCode dynid_estimator_estimate(DynidEstimator *estimator,
                                   const DynidState *state,
                                   double *tau,
                                   size_t n_joints,
                                   uint32_t *status);

/*
 Torque of every term at the last step into terms: n_terms rows of n_joints, n_values doubles in all.

 estimator is NULL or a handle that nobody steps meanwhile; terms is NULL or has room for n_values doubles.
 */
DynidCode dynid_estimator_terms(const DynidEstimator *estimator,
                                double *terms,
                                size_t n_values);

/*
 Standard deviation that the model expects of measured minus predicted torque at the last step into std_dev (n_joints
 doubles).

 estimator is NULL or a handle that nobody else uses meanwhile; std_dev is NULL or has room for n_joints doubles.
 */
DynidCode dynid_estimator_predicted_std(DynidEstimator *estimator,
                                        double *std_dev,
                                        size_t n_joints);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* DYNID_H */
