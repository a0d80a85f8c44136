#pragma once
#include "anigen/core/config.h"

/// JSON of a record by the names of its members, in this order, and back. Json::get throws Json::exception for a key
/// that is missing or of another type.
#define ANIGEN_JSON_RECORD(Type, ...)                                          \
  inline void to_json(Json& nlohmann_json_j, const Type& nlohmann_json_t) {    \
    NLOHMANN_JSON_EXPAND(NLOHMANN_JSON_PASTE(NLOHMANN_JSON_TO, __VA_ARGS__))   \
  }                                                                            \
  inline void from_json(const Json& nlohmann_json_j, Type& nlohmann_json_t) {  \
    NLOHMANN_JSON_EXPAND(NLOHMANN_JSON_PASTE(NLOHMANN_JSON_FROM, __VA_ARGS__)) \
  }
