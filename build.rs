//! Finds MuJoCo, generates its bindings and says how to link it.
//!
//! Search order: `MUJOCO_DIR` (an upstream release, or an unpacked PyPI wheel's `mujoco` folder), then Debian's
//! `libmujoco-dev`. Everything that is missing ends in one error that names what to install.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};

/// Header versions (`mjVERSION_HEADER`) with which all tests pass; others are tried, with a warning.
const TESTED: &[u32] = &[222, 3_017_000];
/// The oldest that is tried, besides 2.2.2: older ones differ in ways that `src/mujoco/compat` does not know.
const OLDEST: u32 = 330;

/// Names with which the crate's code asks for a version: set from that version on.
const FLAGS: &[(&str, u32)] = &[("mujoco3", 300)];

/// Where MuJoCo is: an include folder that holds `mujoco/mujoco.h`, and one library file.
struct Installation {
    include: PathBuf,
    library: PathBuf,
    /// Whether the dynamic loader looks there by itself.
    in_system_path: bool,
}

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=MUJOCO_DIR");
    println!("cargo::rerun-if-env-changed=LIBCLANG_PATH");
    println!("cargo::rerun-if-env-changed=BINDGEN_EXTRA_CLANG_ARGS");

    let found = find().unwrap_or_else(|why| fail(&why));
    let headers = found.include.join("mujoco");
    println!("cargo::rerun-if-changed={}", headers.display());
    println!("cargo::rerun-if-changed={}", found.library.display());

    let version = header_version(&headers.join("mujoco.h")).unwrap_or_else(|why| fail(&why));
    for (flag, from) in FLAGS {
        println!("cargo::rustc-check-cfg=cfg({flag})");
        if version >= *from {
            println!("cargo::rustc-cfg={flag}");
        }
    }
    if !TESTED.contains(&version) {
        if version < OLDEST {
            fail(&format!(
                "the headers in {} are of MuJoCo {}; mujoco-grasp works with 2.2.2 (Debian 12's libmujoco-dev) and \
                 with {} or later (tested: {}). Point MUJOCO_DIR to such an installation, or unset it to use Debian's \
                 package",
                headers.display(),
                readable(version),
                readable(OLDEST),
                tested()
            ));
        }
        println!(
            "cargo::warning=MuJoCo {} ({}) is not among the versions that mujoco-grasp is tested with ({}). It is \
             tried; if the compiler reports errors in src/mujoco, this version differs too much, and MUJOCO_DIR \
             should point to a tested one",
            readable(version),
            headers.display(),
            tested()
        );
    }
    generate(&found.include);
    link(&found);
}

fn find() -> Result<Installation, String> {
    if let Some(dir) = env::var_os("MUJOCO_DIR").filter(|dir| !dir.is_empty()) {
        return find_in(Path::new(&dir));
    }
    let include = PathBuf::from("/usr/include");
    if !include.join("mujoco/mujoco.h").is_file() {
        return Err("MuJoCo's headers were not found in /usr/include/mujoco: install Debian's package libmujoco-dev \
             (apt install libmujoco-dev), or set MUJOCO_DIR to an unpacked MuJoCo release"
            .into());
    }
    let folders = [format!("/usr/lib/{}", multiarch()), "/usr/lib64".into(), "/usr/lib".into()];
    let library = folders.iter().find_map(|dir| library_in(Path::new(dir))).ok_or_else(|| {
        format!(
            "libmujoco.so was not found in {}: install Debian's package libmujoco-dev (apt install libmujoco-dev), \
             or set MUJOCO_DIR to an unpacked MuJoCo release",
            folders.join(", ")
        )
    })?;
    Ok(Installation { include, library, in_system_path: true })
}

/// An upstream release has `include/` and `lib/`; an unpacked wheel has `include/` and the library beside it.
fn find_in(dir: &Path) -> Result<Installation, String> {
    let dir = dir.canonicalize().map_err(|e| format!("MUJOCO_DIR={}: {e}", dir.display()))?;
    let include = [dir.join("include"), dir.join("mujoco/include")]
        .into_iter()
        .find(|include| include.join("mujoco/mujoco.h").is_file())
        .ok_or_else(|| {
            format!(
                "MUJOCO_DIR={}: there is no include/mujoco/mujoco.h below it (an unpacked MuJoCo release, or an \
                 unpacked PyPI wheel's mujoco folder, has one)",
                dir.display()
            )
        })?;
    let folders = ["lib", "lib64", ".", "mujoco"].map(|sub| dir.join(sub));
    let multiarch = dir.join("lib").join(multiarch());
    let library =
        folders.iter().chain([&multiarch]).find_map(|folder| library_in(folder)).ok_or_else(|| {
            format!("MUJOCO_DIR={}: there is no libmujoco.so in it or in its lib folder", dir.display())
        })?;
    Ok(Installation { include, library, in_system_path: false })
}

/// `libmujoco.so` if there is one, else the versioned file of a wheel (`libmujoco.so.2.2.2`).
fn library_in(dir: &Path) -> Option<PathBuf> {
    let plain = dir.join("libmujoco.so");
    if plain.is_file() {
        return Some(plain);
    }
    let mut versioned: Vec<PathBuf> = fs::read_dir(dir)
        .ok()?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.file_name().and_then(|name| name.to_str()).is_some_and(|n| n.starts_with("libmujoco.so.")))
        .collect();
    versioned.sort();
    versioned.pop()
}

fn multiarch() -> String {
    let arch = env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_else(|_| "x86_64".into());
    format!("{arch}-linux-gnu")
}

fn header_version(header: &Path) -> Result<u32, String> {
    let text = fs::read_to_string(header).map_err(|e| format!("cannot read {}: {e}", header.display()))?;
    text.lines()
        .find_map(|line| line.strip_prefix("#define mjVERSION_HEADER")?.split_whitespace().next()?.parse().ok())
        .ok_or_else(|| format!("{} does not define mjVERSION_HEADER", header.display()))
}

fn tested() -> String {
    TESTED.iter().map(|version| readable(*version)).collect::<Vec<_>>().join(", ")
}

/// 222 is 2.2.2; from 3.5 on the number is written 3005000.
fn readable(version: u32) -> String {
    match version {
        0..1000 => format!("{}.{}.{}", version / 100, version / 10 % 10, version % 10),
        _ => format!("{}.{}.{}", version / 1_000_000, version / 1000 % 1000, version % 1000),
    }
}

fn generate(include: &Path) {
    let builder = bindgen::Builder::default()
        .header_contents("mujoco_grasp_wrapper.h", "#include <mujoco/mujoco.h>\n")
        .clang_arg(format!("-I{}", include.display()))
        .allowlist_function("mj_.*|mju_.*|mjv_.*|mjr_.*")
        .allowlist_type("mj.*|_mj.*")
        .allowlist_var("mj.*")
        // The callbacks are process-global and the handlers would be, too: the guard uses the thread's own.
        .blocklist_item("mjcb_.*|mju_user_.*|mjCOLLISIONFUNC")
        // C may hand us any number: an unknown value of a Rust enum would be undefined behaviour.
        .default_enum_style(bindgen::EnumVariation::Consts)
        .prepend_enum_name(false)
        // The error handler unwinds through the engine, so every import must let it.
        .override_abi(bindgen::Abi::CUnwind, ".*")
        .derive_debug(false)
        .generate_comments(false)
        .layout_tests(false);

    // Without libclang bindgen panics; its report is replaced by one that says what to install.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| builder.generate()));
    std::panic::set_hook(hook);
    let bindings = match result {
        Ok(Ok(bindings)) => bindings,
        Ok(Err(why)) => fail(&format!(
            "bindgen could not read MuJoCo's headers ({why}): it needs libclang with its own headers and the C \
             library's (apt install libclang-dev libc6-dev)"
        )),
        Err(_) => fail(
            "libclang was not found; bindgen needs it to read MuJoCo's headers: install Debian's package \
             libclang-dev (apt install libclang-dev), or set LIBCLANG_PATH to the folder of libclang.so",
        ),
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default()).join("bindings.rs");
    bindings.write_to_file(&out).unwrap_or_else(|e| fail(&format!("cannot write {}: {e}", out.display())));
}

fn link(found: &Installation) {
    let folder = found.library.parent().unwrap_or(Path::new("/usr/lib"));
    let name = found.library.file_name().and_then(|name| name.to_str()).unwrap_or("libmujoco.so");
    println!("cargo::rustc-link-search=native={}", folder.display());
    if name == "libmujoco.so" {
        println!("cargo::rustc-link-lib=dylib=mujoco");
    } else {
        println!("cargo::rustc-link-lib=dylib:+verbatim={name}");
    }
    if !found.in_system_path {
        println!("cargo::rustc-link-arg=-Wl,-rpath,{}", folder.display());
    }
}

fn fail(message: &str) -> ! {
    println!("cargo::error={message}");
    std::process::exit(1);
}
