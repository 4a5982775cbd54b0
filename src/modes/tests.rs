mod convergence;
mod laplacian;
mod options;
mod pairs;
