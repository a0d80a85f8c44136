#pragma once
#include <filesystem>
#include <vector>

#include "anigen/engine/prepare.h"
#include "anigen/prepare/dataset.h"

namespace anigen::engine {

/// Steps and tables of a dataset by the options, those of this library and of anigen-prepare; without its sources.
/// @param further what the library has no option for: poses, cleaning rule by rule, limits, splits, workers
/// @throws InputError for an unknown word, which names the program's option
anigen::prepare::PrepareOptions dataset_request(const PrepareOptions& options,
                                                anigen::prepare::PrepareOptions further = {});

/// Adds the sources: assets of the inputs, then creatures. @throws InputError for an option out of range, before hours
/// of listing, or an input that cannot be read
void add_sources(const std::vector<std::filesystem::path>& inputs, const PrepareOptions& options,
                 anigen::prepare::PrepareOptions& dataset);

}  // namespace anigen::engine
