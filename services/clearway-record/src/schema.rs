//! The protobuf messages of a recording, and their descriptions for other programs.
//!
//! `proto/` is the source; the code and the descriptors are made from it when this is built.

use prost::Message;
use prost_types::FileDescriptorSet;
use std::collections::BTreeSet;

/// Messages of our own: the records of the channels without loss.
#[allow(missing_docs, clippy::pedantic, clippy::all)]
pub mod clearway {
    include!(concat!(env!("OUT_DIR"), "/clearway.v1.rs"));
}

/// Messages that Foxglove, Lichtblick and Rerun know by name.
#[allow(missing_docs, clippy::pedantic, clippy::all)]
pub mod foxglove {
    include!(concat!(env!("OUT_DIR"), "/foxglove.rs"));
}

const ALL: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/schemas.bin"));

/// The `FileDescriptorSet` with the file that declares `message`, such as `clearway.v1.State`, and
/// all that it imports: what MCAP asks for as the data of a `protobuf` schema.
pub fn descriptor(message: &str) -> Vec<u8> {
    // Made by our own build: it decodes.
    let all = FileDescriptorSet::decode(ALL).unwrap_or_default();
    let package = message.rsplit_once('.').map_or("", |(package, _)| package);
    let mut wanted: BTreeSet<String> =
        all.file.iter().filter(|file| file.package() == package).map(|file| file.name().to_owned()).collect();
    loop {
        let imported: Vec<String> = all
            .file
            .iter()
            .filter(|file| wanted.contains(file.name()))
            .flat_map(|file| file.dependency.clone())
            .collect();
        let before = wanted.len();
        wanted.extend(imported);
        if wanted.len() == before {
            break;
        }
    }
    let mut file: Vec<_> = all.file.into_iter().filter(|file| wanted.contains(file.name())).collect();
    // Comments and places in the source are of no use to readers, and twice the size of the rest.
    for file in &mut file {
        file.source_code_info = None;
    }
    FileDescriptorSet { file }.encode_to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_descriptor_holds_its_message_and_its_imports_and_nothing_else() {
        let files = |message: &str| {
            let set = FileDescriptorSet::decode(descriptor(message).as_slice()).unwrap();
            set.file.iter().map(|file| file.name().to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(files("clearway.v1.State"), ["clearway/v1/clearway.proto"]);
        let scene = files("foxglove.SceneUpdate");
        assert!(scene.contains(&"google/protobuf/timestamp.proto".to_owned()), "{scene:?}");
        assert!(scene.contains(&"foxglove/poses_and_scenes.proto".to_owned()), "{scene:?}");
        assert_eq!(scene.len(), 3);
    }
}
