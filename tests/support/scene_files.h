#pragma once
#include <string>

#include "tests/support/rig_files.h"

namespace anigen::test {

/// A RigFile, frame Z up, as text scenes with an animation "walk" that turns joint 1 about its x axis from 0 to 90
/// degrees within a second. The rig must be a chain of joints; each joint hangs on the one before.
struct SceneOptions {
  double unit = 1.0;          ///< metres that the file says one of its units is
  double pre_rotation = 0.0;  ///< FBX: degrees about z in joint 1 before its own rotation
  bool animated = true;
  std::string diffuse_texture;   ///< file name of a texture of the only material
  std::string bone_name = "j1";  ///< COLLADA: what the skin calls joint 1
};

std::string collada_text(const RigFile& rig, const SceneOptions& options = {});
std::string fbx_text(const RigFile& rig, const SceneOptions& options = {});

}  // namespace anigen::test
