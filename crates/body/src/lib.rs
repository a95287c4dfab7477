//! Human motion and the body that performs it: loaders, procedural motions, skinned meshes.
