/* State of a resonance.
   @header */
typedef struct {
    double before, y, z;
} mrd_resonator;
