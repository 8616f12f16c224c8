# The paper's comparison of methods, measured
TIS_JIGSAWS=/path/to/jigsaws tis paper --methods --seed 7 --estimators hold,moesp_kf,paper,arx_kf,innovations_kf,direct_ls,transformer,cnn,gpr,srlsmf,drmf
