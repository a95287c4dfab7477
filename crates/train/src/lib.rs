//! Training: losses, schedules, batches, loops, checkpoints that resume.
