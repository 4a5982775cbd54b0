//! What a training leaves: model, checkpoint, figures.

use super::checkpoint::Checkpoint;
use super::report::Report;
use super::trainer::Trainer;
use m4gn_base::{Error, Result};
use m4gn_model::Model;

impl Trainer<'_> {
    /// Writes the best weights as a model file.
    pub(super) fn export(&self) -> Result<()> {
        let Some((weights, normaliser)) = &self.best else {
            return Ok(());
        };
        let mut tensors = self.layout.unflatten(weights);
        tensors.extend(normaliser.tensors());
        let mut spec = self.spec.clone();
        let best = self.progress.best.map(|(step, v)| serde_json::json!({ "step": step, "validation": v }));
        spec.training = serde_json::json!({
            "config": self.progress.config,
            "seed": self.progress.seed,
            "trajectories": self.work.train.len(),
            "best": best,
            "from": self.progress.from,
            "version": env!("CARGO_PKG_VERSION"),
        });
        Model { spec, tensors }.write(&self.request.out)
    }

    /// Writes a checkpoint, if all in it is finite and its weights give a finite loss and gradient, by the batch of the
    /// next step: the last update can have been the one too many. Collective.
    pub(super) fn save(&mut self) -> Result<()> {
        if self.learns(self.progress.step) {
            self.learn(self.progress.step)?;
        }
        self.progress.seconds = self.seconds_of_all();
        if !self.comm.is_root() {
            return self.comm.agree(Ok(()));
        }
        let checkpoint = Checkpoint {
            progress: self.progress.clone(),
            weights: self.optimiser.weights.clone(),
            first: self.optimiser.first.clone(),
            second: self.optimiser.second.clone(),
            average: self.optimiser.average.clone(),
            best: self.best.as_ref().map(|b| b.0.clone()),
            normaliser: self.normaliser.clone(),
            best_normaliser: self.best.as_ref().map(|b| b.1.clone()),
        };
        let path = self.request.checkpoint();
        let whole = checkpoint.check(self.spec, self.layout.len(), &path).map_err(|e| {
            Error::Numerical(format!(
                "the training has diverged: {e}. Nothing was written; the checkpoint before is kept. Lower learning_rate"
            ))
        });
        self.comm.agree(whole.and_then(|()| checkpoint.write(&path)))
    }

    /// The figures of the end. A model file that was removed since, or is of a validation that a resumed training has not repeated, is written
    /// again. Collective.
    pub(super) fn summary(&self, report: &Report) -> Result<serde_json::Value> {
        let (step, v) = self
            .progress
            .best
            .ok_or_else(|| {
                Error::Numerical(
                    "there was no validation whose rollouts stayed finite, so that no model was written: train longer, \
                     lower learning_rate, or set gradient_clip"
                        .into(),
                )
            })?;
        let is_best = |model: Model| model.spec.training["best"]["step"] == step;
        let written = match self.comm.is_root() && !Model::read(&self.request.out).is_ok_and(is_best) {
            true => self.export(),
            false => Ok(()),
        };
        self.comm.agree(written)?;
        let (field, errors) = (self.predicted().next().unwrap_or_default(), v.absolute());
        report.line(&format!("best at step {step}, {field}: {errors}; {}", self.request.out.display()));
        let figures = serde_json::json!({
            "model": { "rmse_1": v.rmse_1[0], "rmse_50": v.rmse_horizon[0], "rmse_all": v.rmse_all[0] },
            "persistence": { "rmse_1": v.rmse_1[1] },
            "hold_first": { "rmse_50": v.rmse_horizon[1], "rmse_all": v.rmse_all[1] },
            "best_step": step,
            "steps": self.progress.step,
            "samples": self.progress.samples,
            "seconds": self.seconds(),
            "weights": self.layout.len(),
            "out": self.request.out,
        });
        self.request.write_json(self.comm, &figures)?;
        Ok(figures)
    }
}
