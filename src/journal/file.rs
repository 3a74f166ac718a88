//! The file that holds a journal's text.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// Largest file that is read, bytes: several times what the largest fleet needs.
const MAX_BYTES: u64 = 64 << 20;
/// Files of one kind that are kept aside at most; then the last one is replaced.
const ASIDE_MAX: u32 = 99;

/// What the file at `path` holds; `None` without one.
///
/// # Errors
/// It is there and cannot be read, or is far too large.
pub fn load(path: &Path) -> io::Result<Option<Vec<u8>>> {
    let file = match File::open(path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        file => file?,
    };
    let mut bytes = Vec::new();
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, "it is larger than any journal"));
    }
    Ok(Some(bytes))
}

/// Puts `text` into the file at `path`. Whatever happens meanwhile, the file is whole afterwards, the one
/// of before or the new one; on return it is the new one, on the disk.
///
/// # Errors
/// It could not be written, and the one of before is still there; or the directory could not be synced,
/// and the new one is there, but may be gone after a loss of power. [`load`] tells which.
pub fn store(path: &Path, text: &str) -> io::Result<()> {
    let new = beside(path, "new");
    let mut file = OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(&new)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()?;
    drop(file);
    std::fs::rename(&new, path)?;
    // The new name has to reach the disk as well.
    File::open(directory(path))?.sync_all()
}

/// Gives the file at `path` a second name, after `why`, under which it stays when the first one gets
/// another content; returns that.
///
/// # Errors
/// It has no other name.
pub fn keep_aside(path: &Path, why: &str) -> io::Result<PathBuf> {
    let mut names = (1..=ASIDE_MAX).map(|n| beside(path, &format!("{why}-{n}")));
    let name = names.clone().find(|name| !name.exists()).or_else(|| names.next_back());
    let name = name.unwrap_or_else(|| beside(path, why));
    // By way of a third name: the last one may be another name of this very file, which a copy would empty.
    let new = beside(path, "aside");
    remove(&new)?;
    // The original stays until it is replaced: at no moment is there none.
    if std::fs::hard_link(path, &new).is_err() {
        std::fs::copy(path, &new)?;
        File::open(&new)?.sync_all()?;
    }
    std::fs::rename(&new, &name)?;
    // Two names of one file are left as they are by a renaming.
    remove(&new)?;
    Ok(name)
}

fn remove(path: &Path) -> io::Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
        _ => Ok(()),
    }
}

fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    name.into()
}

fn directory(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("clearway_journal_{name}_{}", std::process::id()));
            std::fs::create_dir_all(&path).unwrap();
            Self(path)
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn the_file_is_replaced_as_a_whole_and_a_half_written_one_does_no_harm() {
        let folder = Folder::new("store");
        let path = folder.0.join("a.journal");
        assert_eq!(load(&path).unwrap(), None);
        store(&path, "one").unwrap();
        // What a crash leaves before the renaming.
        std::fs::write(beside(&path, "new"), "tw").unwrap();
        assert_eq!(load(&path).unwrap().unwrap(), b"one");
        store(&path, "two").unwrap();
        assert_eq!(load(&path).unwrap().unwrap(), b"two");
        assert_eq!(std::fs::read_dir(&folder.0).unwrap().count(), 1);
        assert!(store(&folder.0.join("none/a.journal"), "three").is_err());
        // A directory in its place: refused, and not taken for none.
        assert!(load(&folder.0).is_err());
    }

    #[test]
    fn what_is_kept_aside_stays_when_the_file_is_replaced() {
        let folder = Folder::new("aside");
        let path = folder.0.join("a.journal");
        for (n, text) in ["one", "two"].iter().enumerate() {
            store(&path, text).unwrap();
            let aside = keep_aside(&path, "damaged").unwrap();
            assert!(aside.to_string_lossy().ends_with(&format!("a.journal.damaged-{}", n + 1)));
            store(&path, "new").unwrap();
            assert_eq!(load(&aside).unwrap().unwrap(), text.as_bytes());
        }
    }

    #[test]
    fn when_every_name_is_taken_the_last_one_goes_and_nothing_is_emptied() {
        let folder = Folder::new("aside_full");
        let path = folder.0.join("a.journal");
        store(&path, "one").unwrap();
        for _ in 0..ASIDE_MAX {
            keep_aside(&path, "damaged").unwrap();
        }
        // Twice the same file, as when the start after the first time failed, and then another one.
        for text in ["one", "two"] {
            if text == "two" {
                store(&path, text).unwrap();
            }
            let aside = keep_aside(&path, "damaged").unwrap();
            assert!(aside.to_string_lossy().ends_with("damaged-99"));
            assert_eq!(load(&aside).unwrap().unwrap(), text.as_bytes());
            assert_eq!(load(&path).unwrap().unwrap(), text.as_bytes());
            assert!(!beside(&path, "aside").exists());
        }
        assert_eq!(load(&beside(&path, "damaged-98")).unwrap().unwrap(), b"one");
    }
}
