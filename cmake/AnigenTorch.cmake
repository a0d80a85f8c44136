# LibTorch.
#
# Debian's TorchConfig drags in include folders that other packages may lack; ask for the pieces instead when
# the config is unusable. Point CMAKE_PREFIX_PATH at another LibTorch (2.x, CUDA) to build against that one.
find_package(Torch REQUIRED)
add_library(anigen_torch INTERFACE)
target_link_libraries(anigen_torch INTERFACE ${TORCH_LIBRARIES})
# PyTorch's own builds bring headers of {fmt} along, of another version than the one that spdlog's library has. Debian's
# lie in a default folder of the compiler, which any -isystem precedes; a link in a folder of ours precedes that.
foreach(torch_include ${TORCH_INCLUDE_DIRS})
  if(EXISTS ${torch_include}/fmt/core.h)
    find_path(FMT_INCLUDE_DIR fmt/core.h PATHS /usr/include NO_DEFAULT_PATH REQUIRED)
    file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/include_roots/fmt)
    file(CREATE_LINK ${FMT_INCLUDE_DIR}/fmt ${CMAKE_BINARY_DIR}/include_roots/fmt/fmt SYMBOLIC)
    target_include_directories(anigen_torch BEFORE INTERFACE ${CMAKE_BINARY_DIR}/include_roots/fmt)
  endif()
endforeach()
# Flags that TorchConfig asks for (the C++ ABI of PyTorch's own builds).
separate_arguments(torch_flags UNIX_COMMAND "${TORCH_CXX_FLAGS}")
target_compile_options(anigen_torch INTERFACE ${torch_flags})
# Training by several processes goes through LibTorch's c10d, whose headers need Gloo's.
find_library(GLOO_LIBRARY gloo)
if(NOT GLOO_LIBRARY)
  message(STATUS "Gloo not found (libgloo-dev): no training by several processes")
endif()
# LibTorch's parallel_for is a template that runs on one thread in code compiled without OpenMP (nn/torch.h refuses
# that). Eigen stays out of it: its products would depend on the number of threads.
find_package(OpenMP REQUIRED COMPONENTS CXX)
target_link_libraries(anigen_torch INTERFACE OpenMP::OpenMP_CXX)
# Classes of LibTorch have members more without NDEBUG: what uses them is compiled as LibTorch was.
target_compile_definitions(anigen_torch INTERFACE EIGEN_DONT_PARALLELIZE $<$<NOT:$<CONFIG:Release>>:NDEBUG>)
