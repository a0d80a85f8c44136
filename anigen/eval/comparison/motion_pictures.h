#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/asset.h"
#include "anigen/eval/pair/pair_evaluation.h"
#include "anigen/io/image.h"

namespace anigen::eval {

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
                                   const Motion* given);

/// Pictures of one ground truth and its predictions.
struct MotionStrip {
  std::string id;
  std::vector<io::Image> frames;  ///< each all rigs at one time, in rows of five; all of one size
  std::string problem;            ///< why there are none; empty when there are
};

/// All rigs at every key of the first one's clip, each in the colours of its own joints' weights. The camera stands
/// still, such that all of the truth's motion is in view. @param size pixels of each rig's picture, a side
/// @throws InputError as raytrace::render()
std::vector<io::Image> motion_frames(const std::vector<MovingRig>& rigs, int size);

/// frame_000.png, frame_001.png, … and truth.glb and <label>.glb with their clips. Older frames there are removed.
/// @throws Error when the disk refuses
void write_motion(const std::filesystem::path& folder, const std::vector<MovingRig>& rigs,
                  const std::vector<io::Image>& frames);

/// The frames as one picture that page scripts scroll: it plays by itself, and stops and turns to dragging.
std::string motion_html(const MotionStrip& strip);

}  // namespace anigen::eval
