# Every third-party library, each from its Debian package; third_party/README.md says what each is for.
find_package(Threads REQUIRED)
find_package(Eigen3 REQUIRED NO_MODULE)
find_package(nlohmann_json REQUIRED)
find_package(spdlog REQUIRED)
find_package(TBB REQUIRED)
find_package(CLI11 REQUIRED)
find_package(OpenCV REQUIRED COMPONENTS core imgproc imgcodecs videoio dnn)
find_package(PkgConfig REQUIRED)
pkg_check_modules(LIBZIP REQUIRED IMPORTED_TARGET libzip)
pkg_check_modules(ASSIMP REQUIRED IMPORTED_TARGET assimp)
find_package(ZLIB REQUIRED)

# Embree 4 (Debian 13) and Embree 3 (Debian 12) differ in header folder and in a few signatures.
find_package(embree 4 QUIET)
if(embree_FOUND)
  set(ANIGEN_EMBREE_VERSION 4)
else()
  find_package(embree 3 REQUIRED)
  set(ANIGEN_EMBREE_VERSION 3)
endif()

# tinygltf, Draco, meshoptimizer and nanoflann: headers and libraries without reliable CMake configurations in Debian 12.
find_path(TINYGLTF_INCLUDE_DIR tiny_gltf.h REQUIRED)
find_library(TINYGLTF_LIBRARY tinygltf REQUIRED)
find_path(DRACO_INCLUDE_DIR draco/compression/decode.h REQUIRED)
find_library(DRACO_LIBRARY draco REQUIRED)
find_path(NANOFLANN_INCLUDE_DIR nanoflann.hpp REQUIRED)
find_path(MESHOPTIMIZER_INCLUDE_DIR meshoptimizer.h REQUIRED)
find_library(MESHOPTIMIZER_LIBRARY meshoptimizer REQUIRED)

# LEMON: its network simplex is used from the headers, but the library holds LEMON's constants.
find_path(LEMON_INCLUDE_DIR lemon/network_simplex.h REQUIRED)
find_library(LEMON_LIBRARY lemon REQUIRED)

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

if(ANIGEN_BUILD_TESTS)
  find_package(GTest REQUIRED)
endif()
if(ANIGEN_BUILD_BENCHMARKS)
  find_package(benchmark REQUIRED)
endif()
if(ANIGEN_WITH_TORCH)
  include(AnigenTorch)
endif()
