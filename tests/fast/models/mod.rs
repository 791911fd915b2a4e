//! Models that come in: what they show by their own rules, and what a bake makes of them.

mod every_family;
mod factors;
mod grid_lies;
mod grids;
mod harmonics;
mod lies;
mod long_rays;
mod merf;
mod model_lies;
mod nanovdb;
mod nerfacto;
mod ngp;
mod ngp_lies;
mod open_inputs;
mod shown;
mod small_models;
mod snerg;
mod source;
mod spheres;
mod svraster;
mod tensor;
mod trained;
mod worlds;
