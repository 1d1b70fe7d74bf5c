//! The declarative test: phases, stimuli, measurements.
