#pragma once
#include <string>

#include "anigen/features/normal_estimator.h"
#include "anigen/io/image.h"

namespace anigen::pipeline {

/// Where the picture of surface normals comes from that conditions the published first stage.
enum class NormalSource {
  kColors,     ///< nowhere: the colour picture stands in, which is what the published training configs show that stage
  kEstimator,  ///< a NormalEstimator sees the whole picture, as published
  kFile,       ///< a picture that the user supplies
  kAuto,       ///< kFile for a picture that comes with a map, kColors for the others
  kFlat        ///< a surface that faces the viewer everywhere, (128, 128, 255): the published pipeline without weights
};

/// @param word auto (kAuto), color, estimator, file or flat @throws InputError for another one
NormalSource parse_normal_source(const std::string& word);

/// Normals as the colours that the published pipeline makes of them: x negated, (n + 1) / 2, rounded down to bytes
/// (reference flows-and-pipeline.md, 5.2, step 1). This is the common colouring of the viewer's frame (X right, Y up,
/// Z towards the viewer): a wall that faces the camera is (127, 127, 255).
/// @param normals [1, 3, H, W] as NormalEstimator returns them @return opaque
/// @throws InputError when they are not finite
io::Image normal_picture(const torch::Tensor& normals);

/// The estimate for a whole picture, its alpha ignored.
/// @param largest_side of the picture that the estimator sees, the estimate being enlarged to the picture's size
/// (Lanczos); 0: the picture as it is, which is what is published
/// @param name of the picture, for messages
io::Image estimated_normals(features::NormalEstimator& estimator, const io::Image& image, int largest_side,
                            const std::string& name);

/// A map that the user supplies, coloured as normal_picture() colours, its alpha ignored, resized (Lanczos) to the
/// picture it belongs to.
/// @throws InputError when its aspect differs from the picture's by more than a pixel or a hundredth
io::Image supplied_normals(const io::Image& map, int width, int height, const std::string& name);

io::Image flat_normals(int width, int height);

}  // namespace anigen::pipeline
