#pragma once
#include <filesystem>
#include <string>

#include "anigen/core/error.h"
#include "anigen/models/run_model.h"

namespace anigen::pipeline {

/// Where the models of a learned rigger are; an empty path: no such model.
struct LearnedModelFiles {
  std::filesystem::path joints, connectivity, skin;
};

/// The folder of the run that a file of weights belongs to, its own or that of its ckpts/; empty when there is none.
std::filesystem::path run_around(const std::filesystem::path& file);

/// A model of a run of anigen-train: a run folder, whose newest weights are taken, averaged where there are averages
/// (models/run_model.h), or a `.safetensors` file of such a folder.
/// @throws InputError naming the file when there is no such thing
models::RunModel model_at(const std::filesystem::path& path, const std::string& class_name);

/// What `make` makes; InputErrors without a file then name this one.
template <typename Make>
auto naming(const std::filesystem::path& file, Make make) -> decltype(make()) {
  try {
    return make();
  } catch (const InputError& error) {
    if (!error.file().empty()) throw;
    throw InputError(file.string(), error.place(), error.problem());
  }
}

}  // namespace anigen::pipeline
