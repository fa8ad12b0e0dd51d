//! object_detector
