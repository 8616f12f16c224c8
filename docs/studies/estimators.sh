# Constant delay, synthetic
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --seeds 4 --duration-s 60 --sweep network.forward.delay.delay_ms=33,100,200,500,1000 --set identification.train_samples=3600 --set 'network={forward: {delay: {kind: constant, delay_ms: 33}}}'

# Outages, synthetic
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --seeds 4 --duration-s 60 --sweep network.outages.0.down.high_s=1,2 --set identification.train_samples=3600 --set 'network={forward: {delay: {kind: constant, delay_ms: 30}}, outages: [{kind: alternating, down: {low_s: 0.5, high_s: 2}, up: {low_s: 2, high_s: 5}, direction: forward}]}'

# Several copies against random delay, synthetic
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --seeds 4 --duration-s 60 --sweep surgeon.copies=1,2,4,8 --set identification.train_samples=3600 --set 'network={forward: {loss: {kind: bernoulli, p_loss: 0.01}, delay: {kind: uniform, low_ms: 200, high_ms: 5000}, ordering: reorder}}'

# Several copies against correlated delay, synthetic
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --seeds 4 --duration-s 60 --sweep surgeon.copies=1,2,4,8 --set identification.train_samples=3600 --set 'network={forward: {loss: {kind: bernoulli, p_loss: 0.01}, delay: {kind: uniform, low_ms: 200, high_ms: 5000}, ordering: reorder}}' --set 'network.forward.correlation={half_life_s: 0.1}'

# Four copies spaced in time, correlated delay, synthetic
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --seeds 4 --duration-s 60 --sweep surgeon.copy_spacing_ms=0,8,33,100 --set identification.train_samples=3600 --set 'network={forward: {loss: {kind: bernoulli, p_loss: 0.01}, delay: {kind: uniform, low_ms: 200, high_ms: 5000}, ordering: reorder}}' --set 'network.forward.correlation={half_life_s: 0.1}' --set surgeon.copies=4

# How long slow moments last, synthetic
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --seeds 4 --duration-s 60 --sweep network.forward.correlation.half_life_s=0.01,0.1,1 --set identification.train_samples=3600 --set 'network={forward: {loss: {kind: bernoulli, p_loss: 0.01}, delay: {kind: uniform, low_ms: 200, high_ms: 5000}, ordering: reorder}}' --set 'surgeon={copies: 4, copy_spacing_ms: 8}'

# History in each packet, synthetic
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --seeds 4 --duration-s 60 --sweep surgeon.history=0,2,8 --set identification.train_samples=3600 --set 'network={forward: {loss: {kind: bernoulli, p_loss: 0.01}, delay: {kind: uniform, low_ms: 200, high_ms: 5000}, ordering: reorder}}'

# An arm that lags, synthetic
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --seeds 4 --duration-s 60 --sweep network.forward.delay.delay_ms=33,100,200,500,1000 --set identification.train_samples=3600 --set 'network={forward: {delay: {kind: constant, delay_ms: 33}}}' --set source.arm_bandwidth_hz=2

# An arm that lags, commands at once, synthetic
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --seeds 4 --duration-s 60 --sweep network.forward.delay.delay_ms=33,100,200,500,1000 --set identification.train_samples=3600 --set 'network={forward: {delay: {kind: constant, delay_ms: 33}}}' --set source.arm_bandwidth_hz=2 --set topology=observer

# Orientation and gripper, synthetic
tis compare default --estimators hold --seeds 4 --duration-s 60 --sweep network.forward.delay.delay_ms=33,100,200,500,1000 --set identification.train_samples=3600 --set 'network={forward: {delay: {kind: constant, delay_ms: 33}}}'

# Constant delay, recorded suturing
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --sweep network.forward.delay.delay_ms=33,100,200,500,1000 --set 'source={kind: jigsaws, task: Suturing, hands: [left, right]}' --set 'network={forward: {delay: {kind: constant, delay_ms: 33}}}'

# Constant delay, rows taken as even, recorded suturing
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --sweep network.forward.delay.delay_ms=33,100,200,500,1000 --set 'source={kind: jigsaws, task: Suturing, hands: [left, right]}' --set 'network={forward: {delay: {kind: constant, delay_ms: 33}}}' --set source.clock=as_recorded

# Outages, recorded suturing
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --trials C005,D005,E005,F005 --sweep network.outages.0.down.high_s=1,2 --set 'source={kind: jigsaws, task: Suturing, hands: [left, right]}' --set 'network={forward: {delay: {kind: constant, delay_ms: 30}}, outages: [{kind: alternating, down: {low_s: 0.5, high_s: 2}, up: {low_s: 2, high_s: 5}, direction: forward}]}'

# Several copies against random delay, recorded suturing
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --trials C005,D005,E005,F005 --sweep surgeon.copies=1,2,4,8 --set 'source={kind: jigsaws, task: Suturing, hands: [left, right]}' --set 'network={forward: {loss: {kind: bernoulli, p_loss: 0.01}, delay: {kind: uniform, low_ms: 200, high_ms: 5000}, ordering: reorder}}'

# Several copies against correlated delay, recorded suturing
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --trials C005,D005,E005,F005 --sweep surgeon.copies=1,2,4,8 --set 'source={kind: jigsaws, task: Suturing, hands: [left, right]}' --set 'network={forward: {loss: {kind: bernoulli, p_loss: 0.01}, delay: {kind: uniform, low_ms: 200, high_ms: 5000}, ordering: reorder}}' --set 'network.forward.correlation={half_life_s: 0.1}'

# Four copies spaced in time, correlated delay, recorded suturing
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --trials C005,D005,E005,F005 --sweep surgeon.copy_spacing_ms=0,8,33,100 --set 'source={kind: jigsaws, task: Suturing, hands: [left, right]}' --set 'network={forward: {loss: {kind: bernoulli, p_loss: 0.01}, delay: {kind: uniform, low_ms: 200, high_ms: 5000}, ordering: reorder}}' --set 'network.forward.correlation={half_life_s: 0.1}' --set surgeon.copies=4

# How long slow moments last, recorded suturing
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --trials C005,D005,E005,F005 --sweep network.forward.correlation.half_life_s=0.01,0.1,1 --set 'source={kind: jigsaws, task: Suturing, hands: [left, right]}' --set 'network={forward: {loss: {kind: bernoulli, p_loss: 0.01}, delay: {kind: uniform, low_ms: 200, high_ms: 5000}, ordering: reorder}}' --set 'surgeon={copies: 4, copy_spacing_ms: 8}'

# History in each packet, recorded suturing
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --trials C005,D005,E005,F005 --sweep surgeon.history=0,2,8 --set 'source={kind: jigsaws, task: Suturing, hands: [left, right]}' --set 'network={forward: {loss: {kind: bernoulli, p_loss: 0.01}, delay: {kind: uniform, low_ms: 200, high_ms: 5000}, ordering: reorder}}'

# Orientation and gripper, recorded suturing
tis compare default --estimators hold --sweep network.forward.delay.delay_ms=33,100,200,500,1000 --set 'source={kind: jigsaws, task: Suturing, hands: [left, right]}' --set 'network={forward: {delay: {kind: constant, delay_ms: 33}}}'

# The paper's rows 1 to 5, delays read as milliseconds, recorded suturing
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --trials C005,D005,E005,F005 --sweep network.profile=paper_1,paper_2,paper_3,paper_4,paper_5 --set 'source={kind: jigsaws, task: Suturing, hands: [left, right]}' --set network.forward.ordering=reorder

# The paper's rows 1 to 5, delays read as samples of 1/30 s, recorded suturing
tis compare default --estimators hold,damped_velocity,moesp_kf,arx_kf,innovations_kf --trials C005,D005,E005,F005 --sweep network.profile=paper_1_samples,paper_2_samples,paper_3_samples,paper_4_samples,paper_5_samples --set 'source={kind: jigsaws, task: Suturing, hands: [left, right]}' --set network.forward.ordering=reorder
