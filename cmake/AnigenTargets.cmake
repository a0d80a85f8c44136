# One library per folder of anigen/, one test program per folder of tests/.
#
# anigen_library(<folder> [DEPENDS <folder>...] [LINK <target>...] [TORCH])
#   Builds anigen_<folder> from every .cpp in anigen/<folder>, sub-folders too. Headers of folders that are not in DEPENDS (or
#   below them) cannot be included: each library exports a private include root that holds only its own folder,
#   so a dependency that points upwards does not compile.
# anigen_test(<folder> [LABEL unit|e2e|fuzz] [DEPENDS <folder>...] [LINK <target>...])
#   Builds test_<folder> from every .cpp in tests/<folder> and registers its cases with ctest.

set(ANIGEN_INCLUDE_ROOTS ${PROJECT_BINARY_DIR}/include_roots)

function(anigen_compile_options target)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic)
  if(ANIGEN_WERROR)
    target_compile_options(${target} PRIVATE -Werror)
  endif()
endfunction()

# GCC 13 and later see overflows in the vector<bool> of LibTorch's autograd functions that are not there, 25 lines each
# time. Builds with GCC 12 keep both warnings.
function(anigen_torch_compile_options target)
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_GREATER_EQUAL 13)
    target_compile_options(${target} PRIVATE -Wno-array-bounds -Wno-stringop-overflow)
  endif()
endfunction()

# Executables are compiled like the libraries (-fPIC, where CMake would say -fPIE): GCC refuses a precompiled header
# that was made with another setting.
function(anigen_same_code_model target)
  set_target_properties(${target} PROPERTIES POSITION_INDEPENDENT_CODE OFF)
  target_compile_options(${target} PRIVATE -fPIC)
endfunction()

# Release builds compile the tests at -O1: a third less work for the compiler, while what the tests run is in the
# libraries.
function(anigen_quick_to_compile target)
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>)
endfunction()

function(anigen_library folder)
  cmake_parse_arguments(ARG "TORCH" "" "DEPENDS;LINK" ${ARGN})
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/anigen/${folder}/*.cpp)
  anigen_leave_out(sources ARG_LINK)
  set(name anigen_${folder})
  # A root with a single entry, anigen/<folder>: what this library lets others include.
  file(MAKE_DIRECTORY ${ANIGEN_INCLUDE_ROOTS}/${folder}/anigen)
  file(CREATE_LINK ${PROJECT_SOURCE_DIR}/anigen/${folder} ${ANIGEN_INCLUDE_ROOTS}/${folder}/anigen/${folder} SYMBOLIC)
  add_library(${name} STATIC ${sources})
  target_include_directories(${name} PUBLIC ${ANIGEN_INCLUDE_ROOTS}/${folder})
  foreach(dependency ${ARG_DEPENDS})
    target_link_libraries(${name} PUBLIC anigen_${dependency})
  endforeach()
  target_link_libraries(${name} PUBLIC ${ARG_LINK})
  anigen_compile_options(${name})
  if(ARG_TORCH)
    target_link_libraries(${name} PUBLIC anigen_torch)
    anigen_torch_compile_options(${name})
    target_precompile_headers(${name} REUSE_FROM anigen_torch_pch)
  elseif("Eigen3::Eigen" IN_LIST ARG_LINK OR ARG_DEPENDS)
    target_precompile_headers(${name} REUSE_FROM anigen_geometry_pch)
  else()
    target_precompile_headers(${name} REUSE_FROM anigen_core_pch)
  endif()
endfunction()

# A program without LibTorch. Only libraries that it uses are loaded with it; its own functions are visible to the
# module that it may load later (apps/common/torch_half.h).
# All programs: what scripts/build.sh --programs builds.
add_custom_target(programs)

function(anigen_app name)
  cmake_parse_arguments(ARG "" "" "DEPENDS;LINK" ${ARGN})
  string(REPLACE "-" "_" source ${name})
  string(REGEX REPLACE "^anigen_" "" source ${source})
  add_executable(${name} ${PROJECT_SOURCE_DIR}/anigen/apps/${source}.cpp)
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin ENABLE_EXPORTS ON)
  anigen_same_code_model(${name})
  foreach(dependency ${ARG_DEPENDS})
    target_link_libraries(${name} PRIVATE anigen_${dependency})
  endforeach()
  target_link_libraries(${name} PRIVATE ${ARG_LINK})
  target_link_options(${name} PRIVATE -Wl,--as-needed)
  anigen_compile_options(${name})
  target_precompile_headers(${name} REUSE_FROM anigen_core_pch)
  add_dependencies(programs ${name})
  set_property(DIRECTORY APPEND PROPERTY ANIGEN_PROGRAMS ${name})
endfunction()

function(anigen_test folder)
  cmake_parse_arguments(ARG "TORCH" "LABEL" "DEPENDS;LINK" ${ARGN})
  if(NOT ARG_LABEL)
    set(ARG_LABEL unit)
  endif()
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/tests/${folder}/*.cpp)
  set(name test_${folder})
  add_executable(${name} ${sources})
  anigen_same_code_model(${name})
  target_link_libraries(${name} PRIVATE anigen_test_support GTest::gtest GTest::gtest_main)
  foreach(dependency ${folder} ${ARG_DEPENDS})
    if(TARGET anigen_${dependency})
      target_link_libraries(${name} PRIVATE anigen_${dependency})
    endif()
  endforeach()
  target_link_libraries(${name} PRIVATE ${ARG_LINK})
  anigen_compile_options(${name})
  # nlohmann 3.11.3 compares keys with pointers while it looks for an operator[], by a function that it calls deprecated.
  target_compile_options(${name} PRIVATE $<$<CXX_COMPILER_ID:Clang>:-Wno-deprecated-declarations>)
  anigen_quick_to_compile(${name})
  if(ARG_TORCH)
    anigen_torch_compile_options(${name})
    target_precompile_headers(${name} REUSE_FROM anigen_torch_test_pch)
  elseif(NOT folder STREQUAL core)
    target_precompile_headers(${name} REUSE_FROM anigen_geometry_test_pch)
  endif()
  anigen_test_suites(${name})
endfunction()

# One ctest test per suite of the program, found when ctest runs. Uses the caller's folder and ARG_LABEL.
function(anigen_test_suites name)
  set(ANIGEN_SUITES_PROGRAM $<TARGET_FILE:${name}>)
  set(ANIGEN_SUITES_LISTING ${CMAKE_CURRENT_BINARY_DIR}/${name}_tests.txt)
  set(script ${CMAKE_CURRENT_BINARY_DIR}/${name}_suites.cmake)
  configure_file(${PROJECT_SOURCE_DIR}/cmake/list_suites.cmake.in ${script}.gen @ONLY)
  file(GENERATE OUTPUT ${script} INPUT ${script}.gen)
  set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES ${script})
endfunction()
