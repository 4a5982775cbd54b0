# The core library as CMake targets: m4gn::core, which is lib/libm4gn.so with cpp/include/m4gn.h and m4gn.hpp, and
# m4gn::header, which is these without the library.

get_filename_component(M4GN_HOME "${CMAKE_CURRENT_LIST_DIR}/.." ABSOLUTE)
set(M4GN_LIB_DIR "${M4GN_HOME}/lib")

# M4GN_CORE_FOLLOWS: it is made before anything is linked with it
if(NOT M4GN_CORE_FOLLOWS AND NOT EXISTS "${M4GN_LIB_DIR}/libm4gn.so")
    message(FATAL_ERROR "lib/libm4gn.so is missing in ${M4GN_HOME}: type setup/build.sh core, which makes it")
endif()

add_library(m4gn::core SHARED IMPORTED)
set_target_properties(m4gn::core PROPERTIES
    IMPORTED_LOCATION "${M4GN_LIB_DIR}/libm4gn.so"
    IMPORTED_SONAME libm4gn.so)
add_library(m4gn::header INTERFACE IMPORTED)
target_include_directories(m4gn::header INTERFACE "${M4GN_HOME}/cpp/include")
target_link_libraries(m4gn::core INTERFACE m4gn::header)

# The archive of src/averages/capi with its header: m4gn::averages
set(M4GN_AVERAGES_ARCHIVE "${M4GN_HOME}/target/release/libm4gn_averages_capi.a" CACHE FILEPATH "Cargo's archive of src/averages/capi")
add_library(m4gn::averages STATIC IMPORTED)
set_target_properties(m4gn::averages PROPERTIES IMPORTED_LOCATION "${M4GN_AVERAGES_ARCHIVE}")
target_include_directories(m4gn::averages INTERFACE "${M4GN_HOME}/src/averages/capi")
target_link_libraries(m4gn::averages INTERFACE ${CMAKE_DL_LIBS} pthread m)

# Our own code is held to these; the headers of others are SYSTEM and stay quiet. (m4gn.h is ours: see the targets'
# NO_SYSTEM_FROM_IMPORTED.)
add_compile_options(-Wall -Wextra -Wpedantic)
