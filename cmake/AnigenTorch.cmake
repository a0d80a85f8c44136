# LibTorch, and one precompiled header for everything that includes it.
#
# Debian's TorchConfig drags in include folders that other packages may lack; ask for the pieces instead when
# the config is unusable. Point CMAKE_PREFIX_PATH at another LibTorch (2.x, CUDA) to build against that one.
find_package(Torch REQUIRED)
add_library(anigen_torch INTERFACE)
target_link_libraries(anigen_torch INTERFACE ${TORCH_LIBRARIES})
# Flags that TorchConfig asks for (the C++ ABI of PyTorch's own builds).
separate_arguments(torch_flags UNIX_COMMAND "${TORCH_CXX_FLAGS}")
target_compile_options(anigen_torch INTERFACE ${torch_flags})

# The precompiled header is built once, in the first target that asks, and shared by the others.
function(anigen_torch_precompiled_header target)
  if(NOT TARGET anigen_torch_pch)
    file(WRITE ${CMAKE_BINARY_DIR}/torch_pch.cpp.in "// Holds the precompiled header of torch.\n")
    configure_file(${CMAKE_BINARY_DIR}/torch_pch.cpp.in ${CMAKE_BINARY_DIR}/torch_pch.cpp COPYONLY)
    add_library(anigen_torch_pch OBJECT ${CMAKE_BINARY_DIR}/torch_pch.cpp)
    target_link_libraries(anigen_torch_pch PRIVATE anigen_torch)
    anigen_compile_options(anigen_torch_pch)
    target_precompile_headers(anigen_torch_pch PRIVATE <torch/torch.h>)
  endif()
  target_precompile_headers(${target} REUSE_FROM anigen_torch_pch)
endfunction()
