# Every third-party library, each from its Debian package; third_party/README.md says what each is for.
find_package(Threads REQUIRED)
find_package(Eigen3 REQUIRED NO_MODULE)
find_package(nlohmann_json REQUIRED)
find_package(CLI11 REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(LIBZIP REQUIRED IMPORTED_TARGET libzip)
find_package(ZLIB REQUIRED)
find_path(NANOFLANN_INCLUDE_DIR nanoflann.hpp REQUIRED)
find_path(LEMON_INCLUDE_DIR lemon/network_simplex.h REQUIRED)

# stb: pictures of a lean build, which all builds compile and test.
find_path(STB_INCLUDE_DIR stb/stb_image.h REQUIRED)

# A lean build takes these two from their headers.
add_library(anigen_spdlog INTERFACE)
add_library(anigen_lemon INTERFACE)
target_include_directories(anigen_lemon INTERFACE ${LEMON_INCLUDE_DIR})
if(ANIGEN_LEAN)
  find_path(SPDLOG_INCLUDE_DIR spdlog/spdlog.h REQUIRED)
  target_include_directories(anigen_spdlog INTERFACE ${SPDLOG_INCLUDE_DIR})
  target_compile_definitions(anigen_spdlog INTERFACE FMT_HEADER_ONLY)
  target_compile_definitions(anigen_lemon INTERFACE LEMON_ONLY_TEMPLATES)
  if(ANIGEN_WITH_TORCH)
    include(AnigenTorch)
  endif()
  return()
endif()

find_package(spdlog REQUIRED)
target_link_libraries(anigen_spdlog INTERFACE spdlog::spdlog)
find_library(LEMON_LIBRARY lemon REQUIRED)  # it holds LEMON's constants
target_link_libraries(anigen_lemon INTERFACE ${LEMON_LIBRARY})
find_package(TBB REQUIRED)
find_package(OpenCV REQUIRED COMPONENTS core imgproc imgcodecs videoio dnn)
pkg_check_modules(ASSIMP REQUIRED IMPORTED_TARGET assimp)
# Its headers alone: of what calls it, anigen/apps/with_opencv links it, and the tests that make pictures.
add_library(opencv_headers INTERFACE)
target_include_directories(opencv_headers SYSTEM INTERFACE ${OpenCV_INCLUDE_DIRS})

# Embree 4 (Debian 13) and Embree 3 (Debian 12) differ in header folder and in a few signatures.
find_package(embree 4 QUIET)
if(embree_FOUND)
  set(ANIGEN_EMBREE_VERSION 4)
else()
  find_package(embree 3 REQUIRED)
  set(ANIGEN_EMBREE_VERSION 3)
endif()

# Draco and meshoptimizer: headers and libraries without reliable CMake configurations in Debian 12.
find_path(DRACO_INCLUDE_DIR draco/compression/decode.h REQUIRED)
find_library(DRACO_LIBRARY draco REQUIRED)
find_path(MESHOPTIMIZER_INCLUDE_DIR meshoptimizer.h REQUIRED)
find_library(MESHOPTIMIZER_LIBRARY meshoptimizer REQUIRED)

# cpp-httplib, a compiled library in Debian: only anigen/studio.
pkg_check_modules(HTTPLIB IMPORTED_TARGET cpp-httplib)
if(NOT HTTPLIB_FOUND)
  message(STATUS "cpp-httplib not found: no anigen-studio")
else()
  # Its header calls OpenSSL by itself from 0.18 on (Debian 13).
  pkg_check_modules(HTTPLIB_OPENSSL IMPORTED_TARGET openssl)
  if(HTTPLIB_OPENSSL_FOUND)
    target_link_libraries(PkgConfig::HTTPLIB INTERFACE PkgConfig::HTTPLIB_OPENSSL)
  endif()
endif()

# CGAL: only anigen/curve_skeleton, anigen/mesh_health and two benchmarks, whose programs are then GPL-3 as binaries.
# Alpha_wrap_3 came with 5.5, which Debian 12 has.
option(ANIGEN_WITH_CGAL "Build curve skeletons and anigen-mesh by CGAL, whose programs are then GPL-3, when CGAL is there" ON)
if(ANIGEN_WITH_CGAL)
  find_package(CGAL 5.5 QUIET)
  if(NOT CGAL_FOUND)
    message(STATUS "CGAL 5.5 or newer not found: no curve skeletons, no anigen-mesh, and benchmarks leave its rows out")
  endif()
endif()

# Debian's Python, whatever other ones are on the path.
option(ANIGEN_WITH_PYTHON "Build the Python module where pybind11 and Python's headers are there" ON)
if(ANIGEN_WITH_PYTHON AND NOT ANIGEN_SANITIZE)
  if(NOT DEFINED Python_EXECUTABLE AND EXISTS /usr/bin/python3)
    set(Python_EXECUTABLE /usr/bin/python3)
  endif()
  find_package(Python COMPONENTS Interpreter Development.Module QUIET)
  if(Python_FOUND)
    find_package(pybind11 CONFIG QUIET)
  endif()
  if(NOT pybind11_FOUND)
    message(STATUS "pybind11 or Python's headers not found: no Python module")
  endif()
endif()

# tinygltf: the second reader of the tests, and what a benchmark compares with.
if(ANIGEN_BUILD_TESTS OR ANIGEN_BUILD_BENCHMARKS)
  find_path(TINYGLTF_INCLUDE_DIR tiny_gltf.h REQUIRED)
  find_library(TINYGLTF_LIBRARY tinygltf REQUIRED)
endif()
if(ANIGEN_BUILD_TESTS)
  find_package(GTest REQUIRED)
endif()
if(ANIGEN_BUILD_BENCHMARKS)
  find_package(benchmark REQUIRED)
endif()
if(ANIGEN_WITH_TORCH)
  include(AnigenTorch)
endif()
