#pragma once
#include <torch/types.h>
#include <cstddef>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/image.h"

namespace anigen::generate {

/// Numbers of vertices by where their colour comes from.
struct PaintedVertices {
  std::size_t seen = 0;      ///< a picture shows them
  std::size_t mirrored = 0;  ///< one shows their mirror image
  std::size_t decoded = 0;   ///< neither: as they were
};

/// Colours vertices by the pictures that an asset was made from: what a camera sees takes the picture's colour, the
/// more the squarer it lies to the view, of several the squarest; what none sees takes the colour of its mirror image
/// at x → −x, where there is one that is seen; the rest keeps its own. Shading in the pictures stays in the colours.
/// @param asset in the object's frame, with vertex colours @param pictures square crops with alpha, the parts that the
/// cameras are of @param cameras [V, 7] in the order of the pictures, see vision::kCameraNumbers
PaintedVertices paint_from_pictures(Asset& asset, const std::vector<io::Image>& pictures, const torch::Tensor& cameras);

}  // namespace anigen::generate
