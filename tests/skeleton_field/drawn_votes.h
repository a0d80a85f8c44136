#pragma once
#include <cstddef>
#include <cstdint>

#include "anigen/core/random.h"
#include "anigen/skeleton_field/voting.h"

namespace anigen::test {

/// Votes as a decoder gives them: for joints in random places, each with a random parent, votes scattered around both
/// with the given deviation, in mixed order, confidences in [0.3, 1).
inline skeleton_field::Votes drawn_votes(std::size_t count, std::size_t joints, double deviation, std::uint64_t seed) {
  Rng rng(seed, "votes");
  std::vector<Eigen::Vector3d> places(joints);
  std::vector<std::size_t> parents(joints);
  for (std::size_t j = 0; j < joints; ++j) {
    for (double& x : places[j]) x = rng.uniform(-0.5, 0.5);
    parents[j] = j == 0 ? 0 : rng.index(j);
  }
  skeleton_field::Votes votes;
  const auto scattered = [&](const Eigen::Vector3d& place) {
    Eigen::Vector3d vote = place;
    for (double& x : vote) x += deviation * rng.normal();
    return Eigen::Vector3f(vote.cast<float>());
  };
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t joint = rng.index(joints);
    votes.joints.push_back(scattered(places[joint]));
    votes.parents.push_back(scattered(places[parents[joint]]));
    votes.joint_confidence.push_back(static_cast<float>(rng.uniform(0.3, 1.0)));
    votes.parent_confidence.push_back(static_cast<float>(rng.uniform(0.3, 1.0)));
  }
  return votes;
}

}  // namespace anigen::test
