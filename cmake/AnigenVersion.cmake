# anigen_version_source(<target>)
#   Compiles the version, the commit, the compiler and LibTorch of this build (anigen/core/version.h) into a library. Every build asks git; the
#   source is written again, and so compiled, only when the answer has changed.
#
# As a script, `cmake -D ROOT=… -D OUTPUT=… -D VERSION=… -D COMPILER=… -D TORCH=… -P AnigenVersion.cmake`, it writes the source OUTPUT for the
# checkout ROOT.

# A commit of documents, tests or experiments changes no program: it leaves the source, and so all programs, as they are.
set(ANIGEN_PROGRAM_PATHS anigen cmake CMakeLists.txt CMakePresets.json)

# Runs git in ROOT. Sets `result` to what it prints, `failed` where there is no git or it refuses.
macro(anigen_ask_git result)
  execute_process(COMMAND ${GIT} --no-optional-locks -C ${ROOT} ${ARGN}
    OUTPUT_VARIABLE ${result} ERROR_QUIET OUTPUT_STRIP_TRAILING_WHITESPACE RESULT_VARIABLE failed)
endmacro()

# Sets `result` to the commit, as anigen/core/version.h says.
function(anigen_find_commit result)
  set(${result} unknown PARENT_SCOPE)
  find_program(GIT git)
  if(NOT GIT)
    return()
  endif()
  # An archive that was unpacked inside another project's checkout is not of that project's commit.
  anigen_ask_git(prefix rev-parse --show-prefix)
  if(failed OR prefix)
    return()
  endif()
  anigen_ask_git(commit log -1 --format=%H HEAD -- ${ANIGEN_PROGRAM_PATHS})
  if(failed OR NOT commit)
    return()
  endif()
  string(SUBSTRING ${commit} 0 10 commit)
  anigen_ask_git(changes status --porcelain -- ${ANIGEN_PROGRAM_PATHS})
  if(changes)
    string(APPEND commit +changes)
  endif()
  set(${result} ${commit} PARENT_SCOPE)
endfunction()

if(CMAKE_SCRIPT_MODE_FILE STREQUAL CMAKE_CURRENT_LIST_FILE)
  foreach(variable GIT_DIR GIT_WORK_TREE GIT_INDEX_FILE)  # of a hook that builds
    unset(ENV{${variable}})
  endforeach()
  anigen_find_commit(commit)
  # The mark lets anigen/experiment/run_jobs.cpp tell the commit from a program's code, and the fixed length
  # leaves everything behind it in its place.
  file(CONFIGURE OUTPUT ${OUTPUT} CONTENT [=[
#include "anigen/core/version.h"

namespace anigen {
namespace {
const char stamp[64] = "anigen commit: @commit@";
}

const char* const kVersion = "@VERSION@";

const char* const kCompiler = "@COMPILER@";
const char* const kTorchVersion = "@TORCH@";

const char* commit() { return stamp + sizeof "anigen commit: " - 1; }

}  // namespace anigen
]=] @ONLY)
  return()
endif()

function(anigen_version_source target)
  set(output ${CMAKE_CURRENT_BINARY_DIR}/version.cpp)
  if(ANIGEN_WITH_TORCH)
    set(torch ${Torch_VERSION})
  endif()
  add_custom_target(${target}_version
    COMMAND ${CMAKE_COMMAND} -D ROOT=${PROJECT_SOURCE_DIR} -D OUTPUT=${output} -D VERSION=${PROJECT_VERSION}
      -D "COMPILER=${CMAKE_CXX_COMPILER_ID} ${CMAKE_CXX_COMPILER_VERSION}" -D TORCH=${torch}
      -P ${PROJECT_SOURCE_DIR}/cmake/AnigenVersion.cmake
    BYPRODUCTS ${output} COMMENT "Asking git for the commit" VERBATIM)
  add_dependencies(${target} ${target}_version)
  target_sources(${target} PRIVATE ${output})
  set_source_files_properties(${output} PROPERTIES GENERATED ON SKIP_UNITY_BUILD_INCLUSION ON SKIP_PRECOMPILE_HEADERS ON)
endfunction()
