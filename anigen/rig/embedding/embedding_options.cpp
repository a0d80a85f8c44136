#include "anigen/rig/embedding/embedding_options.h"

#include <cmath>
#include <initializer_list>
#include <string>

#include "anigen/core/error.h"

namespace anigen::rig {

void check(const EmbeddingOptions& options) {
  const auto require = [](bool good, const char* name, const char* range) {
    if (!good) throw InputError("", std::string("embedding.") + name, std::string("must be ") + range);
  };
  require(options.size > 0.0 && std::isfinite(options.size), "size", "positive");
  require(options.resolution >= 8 && options.resolution <= 512, "resolution", "8 to 512");
  require(options.tolerance >= 0.0 && std::isfinite(options.tolerance), "tolerance", "0 or more");
  require(options.most_spheres >= 1 && options.most_spheres <= 4000, "most_spheres", "1 to 4000");
  require(options.fat_candidates >= 1, "fat_candidates", "1 or more");
  require(options.most_states >= 1, "most_states", "1 or more");
  require(options.beam_width >= 1, "beam_width", "1 or more");
  require(options.most_stretch >= 1.0 && std::isfinite(options.most_stretch), "most_stretch", "1 or more");
  require(options.refinement_rounds >= 0, "refinement_rounds", "0 or more");
  for (const double weight :
       {options.length_weight, options.direction_weight, options.symmetry_weight, options.doubled_weight,
        options.foot_weight, options.duplicate_weight, options.local_direction_weight, options.extremity_weight,
        options.disjoint_weight, options.surface_weight, options.bone_length_weight, options.bone_angle_weight,
        options.bone_symmetry_weight, options.stretch_weight}) {
    require(weight >= 0.0 && std::isfinite(weight), "weights", "0 or more");
  }
}

}  // namespace anigen::rig
