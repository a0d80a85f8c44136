# Precompiled headers: parsing the same few large headers is most of what a build of this project does. One header set
# per family of targets, each built once and shared; a target's own includes stay complete without it.

#
# anigen_precompiled_header_set(<name> HEADERS <header>... LINK <target>... [TESTS])
#   TESTS: for sources that are compiled once and run for seconds (anigen_quick_to_compile).
function(anigen_precompiled_header_set name)
  cmake_parse_arguments(ARG "TESTS" "" "HEADERS;LINK" ${ARGN})
  file(CONFIGURE OUTPUT ${PROJECT_BINARY_DIR}/${name}.cpp CONTENT "// Holds a precompiled header.\n")
  add_library(${name} OBJECT ${PROJECT_BINARY_DIR}/${name}.cpp)
  target_link_libraries(${name} PRIVATE ${ARG_LINK})
  anigen_compile_options(${name})
  if(ARG_TESTS)
    anigen_quick_to_compile(${name})
  endif()
  target_precompile_headers(${name} PRIVATE ${ARG_HEADERS})
endfunction()

set(ANIGEN_STANDARD_HEADERS <algorithm> <array> <cmath> <cstdint> <filesystem> <fstream> <functional> <map> <memory>
  <optional> <set> <sstream> <string> <utility> <vector>)
# What core and the programs share; without Eigen, which core does not use.
anigen_precompiled_header_set(anigen_core_pch
  HEADERS ${ANIGEN_STANDARD_HEADERS} <nlohmann/json.hpp> <spdlog/spdlog.h>
  LINK nlohmann_json::nlohmann_json anigen_spdlog)
# From asset up to eval and prepare.
anigen_precompiled_header_set(anigen_geometry_pch
  HEADERS ${ANIGEN_STANDARD_HEADERS} <nlohmann/json.hpp> <Eigen/Core> <Eigen/Geometry> <Eigen/LU>
  LINK nlohmann_json::nlohmann_json Eigen3::Eigen)
if(ANIGEN_WITH_TORCH)
  anigen_precompiled_header_set(anigen_torch_pch HEADERS <torch/torch.h> LINK anigen_torch)
endif()

# The tests' own sets: a precompiled header decides the level of optimisation of what uses it.
if(ANIGEN_BUILD_TESTS)
  anigen_precompiled_header_set(anigen_geometry_test_pch TESTS
    HEADERS ${ANIGEN_STANDARD_HEADERS} <nlohmann/json.hpp> <Eigen/Core> <Eigen/Geometry> <Eigen/LU> <gtest/gtest.h>
    LINK nlohmann_json::nlohmann_json Eigen3::Eigen GTest::gtest)
  if(ANIGEN_WITH_TORCH)
    anigen_precompiled_header_set(anigen_torch_test_pch TESTS HEADERS <torch/torch.h> <gtest/gtest.h>
      LINK anigen_torch GTest::gtest)
  endif()
endif()
