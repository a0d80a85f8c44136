#pragma once
#include <optional>
#include <string>
#include <utility>

#include "anigen/asset/skeleton.h"
#include "anigen/lint/finding.h"
#include "anigen/lint/welded_rig.h"

namespace anigen::lint {

/// Side that a joint's name says: +1 left, −1 right, and the name without it, in lower case and without a number at
/// its end, which is equal for both of a pair. Understands "Hand.L", "l_hand", "mixamorig:LeftHand", "hand_left_012",
/// "handFBXASC046L"; nothing for "lever" and "bright".
std::optional<std::pair<int, std::string>> side_of_name(const std::string& name);

/// "empty-names", "repeated-names", "refused-names" (characters that engines refuse). Needs names alone.
void check_names(const Skeleton& skeleton, RigLint& lint);

/// Names against places. "unpaired-names": a side without its mirror; "swapped-sides": a pair the other way round than
/// most; "mirrored-names": left is where right should be, by the direction of toes, or from tail to head;
/// "not-upright": the head is not above the feet. Says nothing where names do not tell.
void check_sides(const WeldedRig& rig, RigLint& lint);

}  // namespace anigen::lint
