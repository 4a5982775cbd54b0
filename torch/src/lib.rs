//! Trainable M4GN models: training and inference on libtorch.
