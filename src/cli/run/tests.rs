use super::*;

#[test]
fn durations_have_units() {
    assert_eq!(duration("30s"), Ok(Duration::from_secs(30)));
    assert_eq!(duration("1.5m"), Ok(Duration::from_secs(90)));
    assert_eq!(duration("250ms"), Ok(Duration::from_millis(250)));
    for wrong in ["30", "", "s", "-1s", "1d", "1e300h", "nans"] {
        assert!(duration(wrong).is_err(), "{wrong}");
    }
}
