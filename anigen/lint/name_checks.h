#pragma once
#include "anigen/asset/skeleton.h"
#include "anigen/lint/finding.h"
#include "anigen/lint/welded_rig.h"

namespace anigen::lint {

/// "empty-names", "repeated-names", "refused-names" (characters that engines refuse). Needs names alone.
void check_names(const Skeleton& skeleton, RigLint& lint);

/// Names against places. "unpaired-names": a side without its mirror; "swapped-sides": a pair the other way round than
/// most; "mirrored-names": left is where right should be, by the direction of toes, or from tail to head;
/// "not-upright": the head is not above the feet. Says nothing where names do not tell.
void check_sides(const WeldedRig& rig, RigLint& lint);

}  // namespace anigen::lint
