//! vision_sensor
