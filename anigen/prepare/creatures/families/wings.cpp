#include "anigen/prepare/creatures/families/wings.h"

#include <cmath>

namespace anigen::prepare {

using Eigen::Vector3d;

std::vector<int> add_feathered_wing(Body& body, int parent, int side, const WingShape& w, int bone, int feathers) {
  const double s = side;
  const auto at = [&](double out, double back, double up) {
    return Vector3d(w.shoulder + Vector3d(s * out * w.span, back * w.span, up * w.span));
  };
  const Vector3d elbow = at(0.3, 0.1, 0.05), wrist = at(0.6, -0.02, 0.06), tip = at(1.0, w.sweep, 0.03);
  const std::string name = "wing_" + side_name(side);
  const auto wing =
      body.limb(parent, {name + "_upper", name + "_lower", name + "_hand"}, {w.shoulder, elbow, wrist, tip},
                {w.radius, 0.8 * w.radius, 0.65 * w.radius, 0.4 * w.radius}, bone);
  const Vector3d back(0, w.chord, -0.1 * w.chord);
  const Vector3d root = w.shoulder + 0.95 * back, behind_elbow = elbow + 0.9 * back, behind_wrist = wrist + 0.95 * back;
  const Vector3d behind_tip = tip + 0.35 * back;
  const auto vane = [&](int owner, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
    body.sheet({owner, owner, owner}, {a, b, c}, w.thickness, feathers, {}).blend = 0.5 * w.thickness;
  };
  vane(wing[0], w.shoulder, elbow, behind_elbow);
  vane(wing[0], w.shoulder, behind_elbow, root);
  vane(wing[1], elbow, wrist, behind_wrist);
  vane(wing[1], elbow, behind_wrist, behind_elbow);
  vane(wing[2], wrist, tip, behind_wrist);
  vane(wing[2], tip, behind_tip, behind_wrist);
  return wing;
}

std::vector<int> add_skin_wing(Body& body, int parent, int side, const WingShape& w, int fingers, int bone, int skin) {
  const double s = side;
  const auto at = [&](double out, double back, double up) {
    return Vector3d(w.shoulder + Vector3d(s * out * w.span, back * w.span, up * w.span));
  };
  const std::string name = "wing_" + side_name(side);
  const Vector3d elbow = at(0.22, 0.12, 0.16), wrist = at(0.45, -0.04, 0.26);
  std::vector<int> wing = body.limb(parent, {name + "_upper", name + "_lower"}, {w.shoulder, elbow, wrist},
                                    {w.radius, 0.8 * w.radius, 0.65 * w.radius}, bone);
  std::vector<Vector3d> tips;
  std::vector<int> first, last;
  for (int f = 0; f < fingers; ++f) {
    const double turn = (f + 0.15) / fingers * 1.7;  // from outwards to backwards
    const Vector3d direction(s * std::cos(turn), std::sin(turn) * 0.9, -0.12 - 0.18 * turn);
    const double length = w.span * (0.68 - 0.1 * turn) * (w.chord / w.span + 0.35);
    const Vector3d middle = wrist + 0.5 * length * direction + Vector3d(0, 0, 0.05 * w.span);
    const Vector3d tip = wrist + length * direction;
    const std::string finger = name + "_finger_0" + std::to_string(f + 1);
    const auto chain = body.limb(wing[1], {finger + "_a", finger + "_b"}, {wrist, middle, tip},
                                 {0.5 * w.radius, 0.4 * w.radius, 0.3 * w.radius}, bone);
    first.push_back(chain[0]);
    last.push_back(chain[1]);
    tips.push_back(tip);
    wing.insert(wing.end(), chain.begin(), chain.end());
  }
  const auto skin_between = [&](std::array<int, 3> anchors, std::array<Vector3d, 3> corners, std::vector<int> owners) {
    body.sheet(anchors, corners, w.thickness, skin, owners).blend = 0.8 * w.thickness;
  };
  for (int f = 0; f + 1 < fingers; ++f) {
    // The free edge sags inwards between two fingertips.
    const Vector3d knee_a = body.joints[last[f]].position, knee_b = body.joints[last[f + 1]].position;
    const Vector3d edge = 0.4 * (tips[f] + tips[f + 1]) + 0.2 * wrist;
    const std::vector<int> owners{first[f], last[f], first[f + 1], last[f + 1]};
    skin_between({first[f], first[f], first[f + 1]}, {wrist, knee_a, knee_b}, owners);
    skin_between({last[f], last[f + 1], last[f]}, {knee_a, knee_b, edge}, owners);
    skin_between({last[f], last[f], last[f]}, {knee_a, tips[f], edge}, owners);
    skin_between({last[f + 1], last[f + 1], last[f + 1]}, {knee_b, tips[f + 1], edge}, owners);
  }
  const Vector3d root = w.shoulder + Vector3d(0, 0.9 * w.chord, -0.1 * w.span);
  const Vector3d knee = body.joints[last.back()].position, edge = 0.35 * (root + tips.back()) + 0.3 * elbow;
  const std::vector<int> owners{wing[0], wing[1], first.back(), last.back()};
  skin_between({wing[0], wing[0], wing[0]}, {w.shoulder, elbow, root}, {wing[0]});
  skin_between({wing[0], wing[0], wing[1]}, {root, elbow, edge}, {wing[0], wing[1]});
  skin_between({wing[1], wing[1], last.back()}, {elbow, wrist, knee}, owners);
  skin_between({wing[1], last.back(), wing[1]}, {elbow, knee, edge}, owners);
  skin_between({last.back(), last.back(), wing[1]}, {knee, tips.back(), edge}, owners);
  return wing;
}

}  // namespace anigen::prepare
