#pragma once
#include <torch/types.h>
#include <cstddef>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/image.h"

namespace anigen::generate {

/// Numbers of vertices by where their colour comes from.
struct PaintedVertices {
  std::size_t seen = 0;      ///< the picture shows them
  std::size_t mirrored = 0;  ///< it shows their mirror image
  std::size_t decoded = 0;   ///< neither: as they were
};

/// Colours vertices by the picture that an asset was made from: what the camera sees takes the picture's colour, the
/// more the squarer it lies to the view; what it does not see takes the colour of its mirror image at x → −x, where
/// there is one that is seen; the rest keeps its own. Shading in the picture stays in the colours.
/// @param asset in the object's frame, with vertex colours @param picture square crop with alpha, the part that the
/// camera is of @param camera [7], see vision::kCameraNumbers
PaintedVertices paint_from_picture(Asset& asset, const io::Image& picture, const torch::Tensor& camera);

}  // namespace anigen::generate
