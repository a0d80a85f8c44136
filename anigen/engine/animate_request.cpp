#include "anigen/engine/animate_request.h"

namespace anigen::engine {

motions::MotionOptions motion_options(const AnimateOptions& options) {
  motions::MotionOptions motion;
  motion.frames = options.frames;
  motion.fps = options.fps;
  motion.speed = options.speed;
  motion.travel = options.travel;
  return motion;
}

}  // namespace anigen::engine
