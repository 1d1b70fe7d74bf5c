//! Reference curves, hysteresis models and their inverse, the valve model file.
