//! Frames of a data set against the stride of a model.

use m4gn_base::{Error, Result};
use m4gn_data::interval;

/// How the frames of a trajectory and the model's stride fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Time between frames, s.
    pub interval: f64,
    /// Frames a step.
    pub frames: usize,
    /// Steps that fit.
    pub steps: usize,
}

impl Pace {
    /// Of equidistant `times` and a model's `stride`, s.
    ///
    /// # Errors
    /// [`Error::Model`] when the times are not equidistant, the stride is no multiple of their interval, or there is
    /// not one step.
    pub fn new(times: &[f64], stride: f64) -> Result<Self> {
        let Some((interval, uneven)) = interval(times) else {
            return Err(Error::Model(format!("a step needs two frames, found {}", times.len())));
        };
        if let Some(i) = uneven {
            return Err(Error::Model(format!(
                "frame {i} is at {} s, {} s after the one before, and the {} frames are {interval} s apart on average: \
                 expected equal intervals; record with a fixed time step and interval",
                times[i],
                times[i] - times[i - 1],
                times.len()
            )));
        }
        let frames = (stride / interval).round();
        if frames < 1.0 || (frames * interval - stride).abs() > 1e-3 * interval * frames {
            return Err(Error::Model(format!(
                "the model steps {stride} s and the frames are {interval} s apart: the stride must be a multiple of the interval"
            )));
        }
        let frames = frames as usize;
        match (times.len() - 1) / frames {
            0 => Err(Error::Model(format!(
                "the model steps {stride} s, and the {} frames cover {} s only",
                times.len(),
                times[times.len() - 1] - times[0]
            ))),
            steps => Ok(Pace { interval, frames, steps }),
        }
    }

    /// Whether `times` end before the first step of `stride`, s, does.
    pub fn is_short(times: &[f64], stride: f64) -> bool {
        interval(times).is_none_or(|(interval, _)| (stride / interval).round() > (times.len() - 1) as f64)
    }

    /// What RMSE-50 covers, s from the first frame: [`HORIZON`](super::HORIZON) recorded frames, whatever the model's
    /// stride is. Of flows and of bodies, in training and in validation.
    pub fn rmse_50(&self) -> f64 {
        super::HORIZON as f64 * self.interval
    }

    /// Time from the first frame to the end of the last step, s.
    pub fn duration(&self) -> f64 {
        (self.steps * self.frames) as f64 * self.interval
    }

    /// Steps that end within `time` from the first frame, s; at least one.
    pub fn steps_within(&self, time: f64) -> usize {
        let stride = self.interval * self.frames as f64;
        // Rounding must not cost a step.
        ((time / stride + 1e-3) as usize).max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strides_and_frames() {
        let times: Vec<f64> = (0..11).map(|i| 1.0 + 0.01 * i as f64).collect();
        let pace = Pace::new(&times, 0.05).unwrap();
        assert_eq!((pace.frames, pace.steps), (5, 2));
        assert!((pace.interval - 0.01).abs() < 1e-12);
        assert_eq!((pace.steps_within(0.15), pace.steps_within(0.149), pace.steps_within(0.01)), (3, 2, 1));
        let refused = |times: &[f64], stride: f64| Pace::new(times, stride).unwrap_err().to_string();
        assert!(refused(&times, 0.015).contains("multiple of the interval"));
        assert!(refused(&times, 0.004).contains("multiple of the interval"));
        assert!(refused(&times, 0.2).contains("cover"));
        assert!(refused(&[0.0], 0.1).contains("two frames"));
        assert!(
            [0.2, 0.11].iter().all(|stride| Pace::is_short(&times, *stride)) && Pace::is_short(&[0.0], 0.1)
        );
        assert!([0.1, 0.05, 0.015].iter().all(|stride| !Pace::is_short(&times, *stride)));
        assert!(refused(&[0.0, 0.1, 0.3], 0.1).contains("frame 1 is at 0.1 s, 0.1 s after the one before"));
    }
}
