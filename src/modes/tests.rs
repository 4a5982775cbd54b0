mod convergence;
mod elastic;
mod laplacian;
mod options;
mod pairs;
