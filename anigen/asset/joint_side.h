#pragma once
#include <optional>
#include <string>
#include <utility>

namespace anigen {

/// Side that a joint's name says: +1 left, −1 right, and the name without it, in lower case and without a number at
/// its end, which is equal for both of a pair. Understands "Hand.L", "l_hand", "mixamorig:LeftHand", "hand_left_012",
/// "handFBXASC046L"; nothing for "lever" and "bright".
std::optional<std::pair<int, std::string>> side_of_name(const std::string& name);

}  // namespace anigen
