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

}  // namespace anigen::motions
