#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>

#include "anigen/features/condition_encoder.h"
#include "anigen/models/run_model.h"

namespace anigen::features {

/// What makes tokens of pictures for a trained flow: its run's `image_encoder`, with the newest weights it was trained
/// to beside the flow where it was trained; otherwise frozen DINOv2.
/// @param run folder of the flow @param flow found in it; the other arguments as make_condition_encoder
/// @throws InputError when the encoder or its weights are missing or do not fit
std::unique_ptr<ConditionEncoder> trained_condition_encoder(const std::filesystem::path& run,
                                                            const models::RunModel& flow, std::int64_t image_size,
                                                            std::int64_t channels, torch::Device device);

}  // namespace anigen::features
