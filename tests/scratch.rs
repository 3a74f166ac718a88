use clearway::simulation::{Options, shrink, simulate};
#[test]
fn scratch() {
    for seed in std::env::var("S").unwrap().split(',') {
        let seed: u64 = seed.parse().unwrap();
        let o = simulate(seed, &Options::default()).unwrap();
        println!("@@ {seed} {} {:?}", o.class.name(), o.failures);
        if o.failures.is_empty() {
            continue;
        }
        let (left, small) = shrink(&o, &Options::default()).unwrap();
        let t =
            simulate(seed, &Options { only: Some(left.clone()), trace: true, ..Options::default() }).unwrap();
        println!("@@ {left:?} {:?} lead {}", small.failures, 0);
        for f in &t.faults {
            println!("   {f}");
        }
        let n = t.story.len();
        for l in &t.story[n.saturating_sub(60)..] {
            println!("   {l}");
        }
    }
}
