#pragma once
#include <string>

namespace anigen {

/// Side that a joint's name tells.
struct SidedName {
  int side = 0;      ///< 1 left, −1 right, 0 neither
  std::string rest;  ///< the name in lower case, '*' for the side
  std::string stem;  ///< rest without numbers at its end, which exporters give both of a pair differently
};

/// Understands "Hand.L", "l_hand", "legR", "mixamorig:LeftHand", "hand_left_012", "handFBXASC046L"; not "lever" and
/// "bright".
SidedName side_of_name(const std::string& name);

}  // namespace anigen
