#pragma once
#include <array>
#include <string>
#include <vector>

#include "anigen/eval/skeleton/joint_graph.h"
#include "anigen/io/rigs/joint_tree.h"

namespace anigen::eval {

/// The public conventions for Chamfer distances between skeletons (reference training-and-data.md, 7.2;
/// anymate-baselines.md, 9.3, 10.2, 10.4, 10.5). All average the two directed means of un-squared distances.
enum class SkeletonProtocol {
  kPaper,      ///< exact: bones are lines; bone-to-bone takes samples every 0.005 of one side to the lines of the other
  kRignet,     ///< bones are samples every 0.005, on both sides
  kUnirig,     ///< bones are 100 samples each, whatever their length; distances divided by the coordinate range
  kPuppeteer,  ///< as kRignet, after puppeteer_cleaned() of both sides (MagicArticulate, Puppeteer)
};

/// All, in the order above.
inline constexpr std::array<SkeletonProtocol, 4> kSkeletonProtocols = {
    SkeletonProtocol::kPaper, SkeletonProtocol::kRignet, SkeletonProtocol::kUnirig, SkeletonProtocol::kPuppeteer};

/// "paper", "rignet", "unirig", "puppeteer".
std::string name(SkeletonProtocol protocol);
/// @throws InputError listing the names
SkeletonProtocol parse_skeleton_protocol(const std::string& name);

/// Joint-to-joint, joint-to-bone and bone-to-bone distances, in the unit of the input.
struct SkeletonChamfer {
  double j2j = 0, j2b = 0, b2b = 0;
};

/// Both trees in the same frame, the unit box (longest side 1) for numbers comparable with published ones.
/// @param unirig_range width of the coordinates' range, which kUnirig divides by: 2 for coordinates in [-1, 1], as
///        published; 1 for the unit box, which gives the same number
/// @throws InputError for a tree that check() refuses, or one too large to be sampled (see bone_samples.h)
SkeletonChamfer skeleton_chamfer(const io::JointTree& predicted, const io::JointTree& truth, SkeletonProtocol protocol,
                                 double unirig_range = 1.0);

/// Bones as lines: what kPaper means.
SkeletonChamfer exact_chamfer(const JointGraph& predicted, const JointGraph& truth);
/// Bones as samples every 0.005: what kRignet means, and kPuppeteer on graphs that are clean.
SkeletonChamfer spaced_chamfer(const JointGraph& predicted, const JointGraph& truth);
/// Bones as 100 samples each: kUnirig before it divides by the range.
SkeletonChamfer counted_chamfer(const JointGraph& predicted, const JointGraph& truth);

}  // namespace anigen::eval
