#pragma once
#include "anigen/core/csv.h"

namespace anigen::prepare {

/// Adds to a new metadata.csv the columns of the earlier one that preparing does not write: what other programs know
/// of the assets, such as anigen-encode's ss_latent_<name>. Cells follow the ids (`sha256`); a new asset has False in a
/// column of True and False, and an empty cell in any other. Columns that preparing writes at times, and leaves out now
/// (aesthetic_score, near_skeleton_of, feature_<model>), are not carried over. @param earlier without ids: nothing
void carry_over_columns(CsvTable& table, const CsvTable& earlier);

}  // namespace anigen::prepare
