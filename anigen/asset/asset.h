#pragma once
#include <string>
#include <vector>

#include "anigen/asset/animation.h"
#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"

namespace anigen {

/// An animatable asset: mesh, skeleton, skin weights, and what the file brought along. The mesh is in its bind
/// pose. World frame: right-handed, Z up; the unit is the file's until normalize() was called.
struct Asset {
  std::string name;
  Mesh mesh;
  Skeleton skeleton;
  SkinWeights skin;
  std::vector<Material> materials;
  std::vector<EncodedImage> images;
  std::vector<Animation> animations;
};

}  // namespace anigen
