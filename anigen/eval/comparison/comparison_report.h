#pragma once
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "anigen/eval/comparison/comparison.h"
#include "anigen/eval/comparison/motion_pictures.h"
#include "anigen/eval/pair/pair_evaluation.h"

namespace anigen::eval {

struct ComparisonReportOptions {
  std::string title = "Rigged shapes: predictions against ground truth";
  std::size_t pictured = 6;  ///< so many of the worst assets of each method
  int picture_size = 240;    ///< pixels of one view
  int views = 8;             ///< of the turntable
  int poses = 2;             ///< in which both rigs are shown
  std::string worst_by;      ///< metric that orders assets; empty: the first headline metric with values
  /// Reads and aligns a pair again for its picture; what it throws stands in the report in the picture's place.
  std::function<ComparedShapes(std::size_t method, std::size_t asset)> shapes;
  std::vector<MotionStrip> motions;  ///< every method beside the truth in one motion
};

/// Assets of a method in the report's order: by the metric `worst_by`, or the first headline metric with values when
/// that is empty; then those without a value. Failures come first. @throws InputError for an unknown metric
std::vector<std::size_t> worst_first(const Comparison& comparison, std::size_t method, const std::string& worst_by);

/// One HTML file that needs no other: comparison table, differences, reasons for missing values, a sortable table of
/// all assets with the worst first, motions that play, and for the worst of each method a turntable of ground truth
/// beside prediction (drag to turn), both in the same random poses, and a 3D view of both (WebGL 2) that is loaded on a
/// click.
std::string comparison_report(const Comparison& comparison, const ComparisonReportOptions& options);

}  // namespace anigen::eval
