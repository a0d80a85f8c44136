#pragma once

namespace anigen {

/// Asks the C library to keep what this process frees. Programs that free and ask for the same arrays over and over
/// call it first: otherwise the larger ones go back to the kernel each time, and clearing their pages again takes a
/// tenth of a training step of small models, or of a Gromov–Wasserstein distance. Does nothing without glibc.
void keep_freed_memory();

/// Gives what this process has freed back to the system, for others to use. Does nothing without glibc.
void release_freed_memory();

}  // namespace anigen
