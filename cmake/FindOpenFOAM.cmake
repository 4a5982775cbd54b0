# Finds OpenFOAM: one that is sourced (WM_PROJECT_DIR with headers) or Debian's. The probing itself is done by
# setup/openfoam.sh, which Cargo's side uses too.
#
#   find_package(OpenFOAM REQUIRED [COMPONENTS finiteVolume meshTools ...])
#
# OpenFOAM_VERSION           1912, 2412, ...
# OpenFOAM_PROJECT_DIR       what WM_PROJECT_DIR has to be at run time
# OpenFOAM_LIBRARY_DIR
# OpenFOAM_CXX_STANDARD      what its headers are written in; set it as CXX_STANDARD
# OpenFOAM::headers          flags, macros and header folders (as system headers: their warnings are not ours)
# OpenFOAM::<component>      lib<component>.so and the headers; OpenFOAM::OpenFOAM is always there

set(_script "${CMAKE_CURRENT_LIST_DIR}/../setup/openfoam.sh")
execute_process(
    COMMAND "${_script}" --print
    OUTPUT_VARIABLE _probe ERROR_VARIABLE OpenFOAM_NOT_FOUND_MESSAGE RESULT_VARIABLE _status
    OUTPUT_STRIP_TRAILING_WHITESPACE)

if(_status EQUAL 0)
    string(REPLACE "\n" ";" _lines "${_probe}")
    foreach(_line IN LISTS _lines)
        if(_line MATCHES "^(M4GN_FOAM_[A-Z_]+)=(.*)$")
            set(_${CMAKE_MATCH_1} "${CMAKE_MATCH_2}")
        endif()
    endforeach()
    set(OpenFOAM_VERSION ${_M4GN_FOAM_VERSION})
    set(OpenFOAM_PROJECT_DIR "${_M4GN_FOAM_PROJECT_DIR}")
    set(OpenFOAM_LIBRARY_DIR "${_M4GN_FOAM_LIBDIR}")
    set(OpenFOAM_CXX_STANDARD ${_M4GN_FOAM_CXXSTD})
    string(REPLACE ":" ";" _includes "${_M4GN_FOAM_INCLUDES}")
    string(REPLACE " " ";" _defines "${_M4GN_FOAM_DEFINES}")

    foreach(_component IN ITEMS OpenFOAM LISTS OpenFOAM_FIND_COMPONENTS)
        if(EXISTS "${OpenFOAM_LIBRARY_DIR}/lib${_component}.so")
            set(OpenFOAM_${_component}_FOUND TRUE)
        endif()
    endforeach()
endif()

# Indented lines are not wrapped
string(REPLACE "\n" "\n  " OpenFOAM_NOT_FOUND_MESSAGE "${OpenFOAM_NOT_FOUND_MESSAGE}")
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenFOAM
    REQUIRED_VARS OpenFOAM_LIBRARY_DIR OpenFOAM_PROJECT_DIR
    VERSION_VAR OpenFOAM_VERSION
    HANDLE_COMPONENTS
    REASON_FAILURE_MESSAGE "\n${OpenFOAM_NOT_FOUND_MESSAGE}")

if(OpenFOAM_FOUND AND NOT TARGET OpenFOAM::headers)
    add_library(OpenFOAM::headers INTERFACE IMPORTED)
    target_include_directories(OpenFOAM::headers SYSTEM INTERFACE ${_includes})
    # Among them: __restrict__= (see setup/openfoam.sh), without which in-place tensor products are silently wrong.
    target_compile_definitions(OpenFOAM::headers INTERFACE ${_defines})
    # As OpenFOAM's own rules have it; its templates meet these in our code when they are instantiated there.
    target_compile_options(OpenFOAM::headers INTERFACE
        -ftemplate-depth=100 -Wno-old-style-cast -Wno-unused-local-typedefs -Wno-invalid-offsetof
        -Wno-attributes -Wno-unknown-pragmas -Wno-overloaded-virtual)

    foreach(_component IN ITEMS OpenFOAM LISTS OpenFOAM_FIND_COMPONENTS)
        if(OpenFOAM_${_component}_FOUND AND NOT TARGET OpenFOAM::${_component})
            add_library(OpenFOAM::${_component} SHARED IMPORTED)
            # Without a recorded soname the linker would store the full path of the library.
            set_target_properties(OpenFOAM::${_component} PROPERTIES
                IMPORTED_LOCATION "${OpenFOAM_LIBRARY_DIR}/lib${_component}.so"
                IMPORTED_NO_SONAME TRUE)
            target_link_libraries(OpenFOAM::${_component} INTERFACE OpenFOAM::headers)
        endif()
    endforeach()

    # Templates of libOpenFOAM call straight into libPstream, which stands in a folder of its own per MPI.
    find_library(OpenFOAM_PSTREAM Pstream NO_DEFAULT_PATH
        PATHS "${_M4GN_FOAM_MPI_LIBDIR}" "${OpenFOAM_LIBRARY_DIR}" "${OpenFOAM_LIBRARY_DIR}/dummy")
    if(NOT OpenFOAM_PSTREAM)
        message(FATAL_ERROR "libPstream.so was not found in ${_M4GN_FOAM_MPI_LIBDIR}, ${OpenFOAM_LIBRARY_DIR} or "
            "${OpenFOAM_LIBRARY_DIR}/dummy: source OpenFOAM's etc/bashrc, or compile its src/Pstream")
    endif()
    add_library(OpenFOAM::Pstream SHARED IMPORTED)
    set_target_properties(OpenFOAM::Pstream PROPERTIES
        IMPORTED_LOCATION "${OpenFOAM_PSTREAM}" IMPORTED_NO_SONAME TRUE)
    target_link_libraries(OpenFOAM::OpenFOAM INTERFACE OpenFOAM::Pstream)
endif()
