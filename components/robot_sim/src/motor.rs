//! A DC motor with its wheel, and the speed controller of its driver.
//!
//! `J dω/dt = k (U - k ω) / R - friction`: first-order inertia whose drag is the back-emf. Without power the driver
//! shorts the winding, so the back-emf brakes the wheel; `neutral` is the same with power on.
//!
//! Decision: voltage and back-emf rather than a filtered set point. The filter is one line, but then a motor whose
//! driver has lost power, or that is in neutral, needs a second and third model that agree with the first.

use board_protocol::robot::SUPPLY_MV;

/// Volts per radian per second at the wheel, and newton metres per ampere.
const COUPLING: f64 = 0.66;
/// Ohms.
const RESISTANCE: f64 = 3.4;
/// Kilogram square metres at the wheel: a quarter of the robot's mass, seen through the wheel's radius.
const INERTIA: f64 = 0.0078;
/// Newton metres of rolling and gear friction.
const FRICTION: f64 = 0.15;
/// Volts per radian per second of speed error.
const GAIN: f64 = 0.8;
/// Below this speed friction holds the wheel, in radians per second.
const STANDSTILL: f64 = 1e-3;

/// What the driver does with its motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drive {
    /// Hold this wheel speed, in radians per second.
    Speed(f64),
    /// No voltage: neutral, or no driver power.
    Neutral,
}

/// One motor and its wheel.
#[derive(Debug, Clone, Copy, Default)]
pub struct Motor {
    speed: f64,
    angle: f64,
    current: f64,
}

impl Motor {
    /// Wheel speed, in radians per second.
    #[must_use]
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Way the wheel has turned since the start, in radians.
    #[must_use]
    pub fn angle(&self) -> f64 {
        self.angle
    }

    /// Current drawn from the supply, in amperes.
    #[must_use]
    pub fn supply_current(&self) -> f64 {
        self.current.abs()
    }

    /// Goes on by `dt` seconds.
    pub fn step(&mut self, drive: Drive, dt: f64) {
        let (voltage, powered) = match drive {
            Drive::Speed(wanted) => (self.controller(wanted), true),
            Drive::Neutral => (0.0, false),
        };
        let current = (voltage - COUPLING * self.speed) / RESISTANCE;
        self.speed = with_friction(self.speed + COUPLING * current / INERTIA * dt, FRICTION / INERTIA * dt);
        self.angle += self.speed * dt;
        self.current = if powered { current } else { 0.0 };
    }

    /// Feed-forward of back-emf and friction, plus a proportional part; limited to the supply.
    fn controller(&self, wanted: f64) -> f64 {
        let limit = f64::from(SUPPLY_MV) / 1000.0;
        let friction = if wanted.abs() < STANDSTILL { 0.0 } else { wanted.signum() * FRICTION * RESISTANCE / COUPLING };
        (COUPLING * wanted + friction + GAIN * (wanted - self.speed)).clamp(-limit, limit)
    }
}

/// Friction takes up to `loss` of the speed and never turns the wheel round.
fn with_friction(speed: f64, loss: f64) -> f64 {
    if speed.abs() <= loss { 0.0 } else { speed - loss.copysign(speed) }
}

#[cfg(test)]
mod tests {
    use super::{Drive, Motor};

    fn after(mut motor: Motor, drive: Drive, seconds: f64) -> Motor {
        (0..(seconds / 0.002) as u32).for_each(|_| motor.step(drive, 0.002));
        motor
    }

    #[test]
    fn reaches_its_set_point_gradually() {
        let early = after(Motor::default(), Drive::Speed(6.0), 0.01).speed();
        let late = after(Motor::default(), Drive::Speed(6.0), 0.3).speed();
        assert!(early > 0.5 && early < 5.0, "{early}");
        assert!((late - 6.0).abs() < 0.05, "{late}");
    }

    #[test]
    fn back_emf_brakes_a_motor_without_power() {
        let running = after(Motor::default(), Drive::Speed(6.0), 0.3);
        let braking = after(running, Drive::Neutral, 0.05).speed();
        assert!(braking > 0.1 && braking < 4.0, "{braking}");
        assert!(after(running, Drive::Neutral, 0.5).speed() == 0.0);
    }

    #[test]
    fn stands_still_without_a_set_point() {
        assert!(after(Motor::default(), Drive::Speed(0.0), 1.0).angle() == 0.0);
    }
}
