#pragma once
#include <filesystem>
#include <string>

namespace anigen::pipeline {

/// The run folder that another run's config names. A relative name counts from the working directory, as published;
/// where nothing is there, from the nearest parent folder of the naming run in which it exists, so that a released tree
/// works from anywhere ("ckpts/anigen/ss_dae" in ckpts/anigen/ss_flow_duet/config.json).
/// @param run the naming run's folder @param config, pointer where the name stands, for messages
/// @throws InputError when the name is empty or no such folder exists
std::filesystem::path named_run(const std::filesystem::path& run, const std::string& name,
                                const std::filesystem::path& config, const std::string& pointer);

}  // namespace anigen::pipeline
