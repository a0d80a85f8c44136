#pragma once
#include <string>

#include "anigen/eval/comparison/comparison_report.h"

namespace anigen::eval {

/// A turntable of ground truth beside prediction as one strip of views that page scripts scroll by dragging.
std::string turntable_html(const ComparedShapes& shapes, int views, int size);

/// Both shapes in the same random poses (posed_pair()), each in the colours of its own joints' weights: truth and
/// prediction per pose. Empty unless both have faces, joints and weights. @param seed of the poses
std::string posed_html(const ComparedShapes& shapes, int poses, int size, std::uint64_t seed);

/// A button that opens both shapes in 3D; their geometry stands in the page as JSON. Meshes of more than
/// kMostViewedFaces faces are shown as points. @param id unique within the page
std::string view_html(const ComparedShapes& shapes, const std::string& id);

inline constexpr std::size_t kMostViewedFaces = 60000;

}  // namespace anigen::eval
