/* Inputs of the force model at one sample, after conditioning.
   @needs bits
   @source */
typedef struct {
    double dt_s; /* since the sample before; NaN at the first one and after a gap */
    double displacement_m;
    double velocity_m_s;
    double acceleration_m_s2; /* NaN if not known */
    double drive;
    double case_temp_c; /* NaN if not known */
} mrd_model_inputs;
