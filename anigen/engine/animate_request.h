#pragma once
#include "anigen/engine/animate.h"
#include "anigen/motions/built_in.h"

namespace anigen::engine {

/// Options of motions, those of this library and of anigen-animate.
motions::MotionOptions motion_options(const AnimateOptions& options);

}  // namespace anigen::engine
