#pragma once
#include "anigen/asset/asset.h"
#include "anigen/core/json.h"
#include "anigen/prepare/augment/provenance.h"
#include "anigen/prepare/metadata.h"

namespace anigen::prepare {

/// The columns of the first step: what was measured of an imported asset, and of a variant also where it came from.
Json import_columns(const AssetRecord& record);

/// @param source columns of the asset that was posed @param posed null when no pose passed; the columns then only say
/// why
Json variant_columns(const Json& source, const Asset* posed, const Provenance& provenance);

/// x → scale · x + offset, from the source to the dataset.
Similarity normalisation_of(const Json& columns);
bool is_rejected_pose(const Json& columns);
/// Whether this version of the program understands them.
bool readable(const Json& columns);
/// @throws InputError when they are not what import_columns() or variant_columns() made
AssetRecord record_from_columns(const Json& columns);

}  // namespace anigen::prepare
