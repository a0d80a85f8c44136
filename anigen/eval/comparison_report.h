#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/eval/comparison.h"
#include "anigen/eval/pair.h"
#include "anigen/io/image.h"

namespace anigen::eval {

/// Parts that all reports share: <head> with style, and the scripts for sortable tables, turntables and
/// 3D views, so that a page needs no other file.
std::string page_begin(const std::string& title);
std::string page_end();

/// One row of a comparison for one ground truth.
struct MotionRow {
  std::string label;
  std::optional<ComparedShapes> shapes;  ///< nothing: no prediction, or none that can move
};

/// A rig with its clip; nothing to draw where a row has no shapes.
struct MovingRig {
  std::string label;
  std::optional<Asset> asset;  ///< its first animation is the motion, in the frame of scores
};

/// The truth and then every row, all in the truth's motion (same_motion()). Rigs of several roots are joined
/// (to_asset()). @throws InputError when no row has shapes with joints, faces and weights
std::vector<MovingRig> moving_rigs(const std::vector<MotionRow>& rows, const PairSettings& settings,
                                   const metrics::Motion* given);

/// Pictures of one ground truth and its predictions.
struct MotionStrip {
  std::string id;
  std::vector<io::Image> frames;  ///< each all rigs at one time, in rows of five; all of one size
  std::string problem;            ///< why there are none; empty when there are
};

/// All rigs at every key of the first one's clip, each in the colours of its own joints' weights. The camera stands
/// still, such that all of the truth's motion is in view. @param size pixels of each rig's picture, a side
/// @throws InputError as render::render()
std::vector<io::Image> motion_frames(const std::vector<MovingRig>& rigs, int size);

/// frame_000.png, frame_001.png, … and truth.glb and <label>.glb with their clips. Older frames there are removed.
/// @throws Error when the disk refuses
void write_motion(const std::filesystem::path& folder, const std::vector<MovingRig>& rigs,
                  const std::vector<io::Image>& frames);

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
