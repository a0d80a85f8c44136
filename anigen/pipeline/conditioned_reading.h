#pragma once
#include <string>

#include "anigen/core/config_reader.h"
#include "anigen/models/run_model.h"

namespace anigen::pipeline {

/// How a flow that was conditioned on pictures read its dataset.
/// @tparam Options of the dataset's class @param dataset name of that class
/// @throws InputError when the flow was trained on another one
template <typename Options>
Options conditioned_reading(const models::RunModel& flow, const std::string& dataset) {
  ConfigReader top(flow.run, flow.config.string());
  ConfigReader reader = top.object("dataset");
  reader.require("name");
  if (reader.text("name", "") != dataset) {
    throw reader.error("name", "this flow was trained without pictures; they come from " + dataset);
  }
  ConfigReader args = reader.object("args");
  return Options::read(args, true);
}

}  // namespace anigen::pipeline
