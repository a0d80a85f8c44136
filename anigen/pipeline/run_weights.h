#pragma once
#include <filesystem>
#include <string>

#include "anigen/core/json.h"

namespace anigen::pipeline {

/// Whether a run folder holds the weights that its config asks for: for every model under /models an object of
/// `class`; `checkpoint`, the file that generation would read; `tensors`, how many the model has, and `parameters`,
/// their elements; `complete`; and where not, `problem`, or `missing`, `unexpected` and `misshapen` with the number of
/// keys and the first of them. Models are built without initial values, files are read whole.
/// @throws InputError when there is no readable config.json
Json describe_weights(const std::filesystem::path& run);

/// One sentence about the first model of a description whose weights are not all there; empty when all are.
std::string first_incomplete(const Json& weights);

}  // namespace anigen::pipeline
