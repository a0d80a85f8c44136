#include "anigen/motions/contact.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "anigen/core/numeric.h"

namespace anigen::motions {

double foot_slide(const Body& body, const BodyMotion& motion, const Animation& clip, const Skeleton& skeleton) {
  constexpr int kBetween = 4;  // samples per step between keys
  double largest = 0.0;
  for (const FootContact& contact : motion.contacts) {
    const Limb& leg = body.limbs[at(contact.leg)];
    const int ankle = leg.joints[leg.ankle];
    const Eigen::Vector4d sole = skeleton.bind[at(ankle)].inverse() * leg.contact.homogeneous();
    std::size_t f = 0;
    while (f < motion.times.size()) {
      if (!contact.stands[f]) {
        ++f;
        continue;
      }
      Box box;
      for (; f < motion.times.size() && contact.stands[f]; ++f) {
        const bool goes_on = f + 1 < motion.times.size() && contact.stands[f + 1];
        for (int k = 0; k < (goes_on ? kBetween : 1); ++k) {
          const double step = goes_on ? motion.times[f + 1] - motion.times[f] : 0.0;
          const double time = motion.times[f] + step * k / kBetween;
          const auto world = forward_kinematics(skeleton.parents, sample(clip, skeleton, time));
          Eigen::Vector3d place = (world[at(ankle)] * sole).head<3>() - time * motion.ground_velocity;
          place.z() = 0.0;
          box.extend(place);
        }
      }
      largest = std::max(largest, box.diagonal());
    }
  }
  return largest / body.figure.height;
}

std::size_t keep_feet(const Body& body, BodyMotion& motion) {
  constexpr std::size_t kFade = 4;      // frames
  constexpr std::size_t kShortest = 3;  // frames that a foot stands at least
  const std::size_t frames = motion.poses.size();
  std::vector<bool> held(frames, false);
  for (const FootContact& contact : motion.contacts) {
    const Limb& leg = body.limbs[at(contact.leg)];
    if (leg.ankle <= leg.hip + 1) continue;  // no knee to bend
    const int ankle = leg.joints[leg.ankle];
    std::vector<Eigen::Vector3d> correction(frames, Eigen::Vector3d::Zero());
    std::vector<double> strength(frames, 0.0);
    for (std::size_t f = 0; f < frames;) {
      if (!contact.stands[f]) {
        ++f;
        continue;
      }
      std::size_t end = f;
      Eigen::Vector3d mean = Eigen::Vector3d::Zero();
      for (; end < frames && contact.stands[end]; ++end) mean += motion.poses[end][at(ankle)](leg.contact);
      const std::size_t count = end - f;
      if (count >= kShortest) {
        mean /= static_cast<double>(count);
        mean.z() = leg.contact.z();
        for (std::size_t k = f; k < end; ++k) {
          correction[k] = mean - motion.poses[k][at(ankle)](leg.contact);
          strength[k] = 1.0;
          held[k] = true;
        }
        for (std::size_t k = 1; k <= kFade; ++k) {
          const double fade = 1.0 - static_cast<double>(k) / (kFade + 1);
          if (f >= k && !contact.stands[f - k] && fade > strength[f - k])
            correction[f - k] = fade * correction[f], strength[f - k] = fade;
          if (end - 1 + k < frames && !contact.stands[end - 1 + k] && fade > strength[end - 1 + k])
            correction[end - 1 + k] = fade * correction[end - 1], strength[end - 1 + k] = fade;
        }
      }
      f = end;
    }
    for (std::size_t f = 0; f < frames; ++f) {
      if (!(strength[f] > 0.0)) continue;
      Poser poser(body);
      poser.set(motion.poses[f]);
      const Eigen::Vector3d place = motion.poses[f][at(ankle)](body.figure.tree.positions[at(ankle)]) + correction[f];
      poser.move_foot(leg, place);
      motion.poses[f] = poser.motions();
    }
  }
  return static_cast<std::size_t>(std::count(held.begin(), held.end(), true));
}

}  // namespace anigen::motions
