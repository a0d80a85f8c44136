#include "anigen/eval/skeleton/skeleton_chamfer.h"

#include "anigen/core/error.h"
#include "anigen/eval/skeleton/bone_samples.h"
#include "anigen/eval/skeleton/nearest_bone.h"
#include "anigen/eval/skeleton/puppeteer_cleaning.h"

namespace anigen::eval {
namespace {

double symmetric(double there, double back) { return 0.5 * (there + back); }

/// @param bones what distances to bones are measured to, of either side
SkeletonChamfer chamfer(const JointGraph& a, const JointGraph& b, const std::vector<BoneSamples>& samples_a,
                        const std::vector<BoneSamples>& samples_b, const NearestBone& bones_a,
                        const NearestBone& bones_b) {
  SkeletonChamfer result;
  result.j2j = symmetric(NearestBone::of_points(b.joints).mean_distance(a.joints),
                         NearestBone::of_points(a.joints).mean_distance(b.joints));
  result.j2b = symmetric(bones_b.mean_distance(a.joints), bones_a.mean_distance(b.joints));
  result.b2b = symmetric(bones_b.mean_distance(samples_a), bones_a.mean_distance(samples_b));
  return result;
}

SkeletonChamfer sampled(const JointGraph& a, const JointGraph& b, const std::vector<BoneSamples>& samples_a,
                        const std::vector<BoneSamples>& samples_b) {
  return chamfer(a, b, samples_a, samples_b, NearestBone(samples_a), NearestBone(samples_b));
}

}  // namespace

std::string name(SkeletonProtocol protocol) {
  switch (protocol) {
    case SkeletonProtocol::kPaper:
      return "paper";
    case SkeletonProtocol::kRignet:
      return "rignet";
    case SkeletonProtocol::kUnirig:
      return "unirig";
    case SkeletonProtocol::kPuppeteer:
      return "puppeteer";
  }
  return "";
}

SkeletonProtocol parse_skeleton_protocol(const std::string& text) {
  for (const SkeletonProtocol protocol : kSkeletonProtocols) {
    if (name(protocol) == text) return protocol;
  }
  throw InputError("", "protocol", "\"" + text + "\" is none of paper, rignet, unirig, puppeteer");
}

SkeletonChamfer exact_chamfer(const JointGraph& predicted, const JointGraph& truth) {
  const std::vector<BoneLine> a = bone_lines(predicted), b = bone_lines(truth);
  return chamfer(predicted, truth, spaced_samples(a), spaced_samples(b), NearestBone(a), NearestBone(b));
}

SkeletonChamfer spaced_chamfer(const JointGraph& predicted, const JointGraph& truth) {
  return sampled(predicted, truth, spaced_samples(bone_lines(predicted)), spaced_samples(bone_lines(truth)));
}

SkeletonChamfer counted_chamfer(const JointGraph& predicted, const JointGraph& truth) {
  return sampled(predicted, truth, counted_samples(bone_lines(predicted)), counted_samples(bone_lines(truth)));
}

SkeletonChamfer skeleton_chamfer(const io::JointTree& predicted, const io::JointTree& truth, SkeletonProtocol protocol,
                                 double unirig_range) {
  switch (protocol) {
    case SkeletonProtocol::kPaper:
      return exact_chamfer(joint_graph(predicted), joint_graph(truth));
    case SkeletonProtocol::kRignet:
      return spaced_chamfer(joint_graph(predicted), joint_graph(truth));
    case SkeletonProtocol::kPuppeteer:
      return spaced_chamfer(puppeteer_cleaned(predicted), puppeteer_cleaned(truth));
    case SkeletonProtocol::kUnirig:
      break;
  }
  if (!(unirig_range > 0.0)) throw InputError("", "unirig_range", "the coordinate range must be positive");
  SkeletonChamfer result = counted_chamfer(joint_graph(predicted), joint_graph(truth));
  result.j2j /= unirig_range;
  result.j2b /= unirig_range;
  result.b2b /= unirig_range;
  return result;
}

}  // namespace anigen::eval
